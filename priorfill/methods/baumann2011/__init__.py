"""Baumann et al. 2011, Krüger et al. 2010, and weighted votes."""
