"""What a person reads of a study: a page, JSON and tables, the worst trials first."""
