"""Marker sets: segments, reliable markers, mirror pairs, root frames."""
