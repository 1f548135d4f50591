"""The energy of Baumann et al. 2011, and its minimisers."""
