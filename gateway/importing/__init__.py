"""Foreign measurements in: CSV, MAT and Parquet become recordings."""
