"""Results as tables: CSV, Parquet and JSON lines."""
