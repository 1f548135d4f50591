"""How does a user look at a fill? A page of one file, plots, and summaries."""
