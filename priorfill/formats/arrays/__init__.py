"""Files of named arrays: NumPy (.npz) and MATLAB (.mat)."""
