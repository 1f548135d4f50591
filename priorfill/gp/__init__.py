"""Gaussian-process regression from visible to missing markers."""
