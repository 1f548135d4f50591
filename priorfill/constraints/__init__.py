"""Plausibility: segment lengths, floor, velocities."""
