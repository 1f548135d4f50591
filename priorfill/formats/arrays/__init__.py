"""Array files: npz, mat."""
