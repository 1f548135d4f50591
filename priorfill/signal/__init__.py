"""Trajectories over time: resampling, smoothing, interpolation."""
