"""Training data and ensembles for a gap segment."""
