"""Text tables and Parquet."""
