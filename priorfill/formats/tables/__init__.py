"""Text tables: TRC, Nexus, Qualisys, Motive."""
