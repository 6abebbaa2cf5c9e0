"""Files of named arrays: NumPy, MATLAB, HDF5."""
