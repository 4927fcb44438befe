"""Foreign measurements in: CSV, MATLAB, HDF5, MDF and Parquet become recordings."""
