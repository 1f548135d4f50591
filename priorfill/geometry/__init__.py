"""Geometry of markers and poses, on arrays only."""
