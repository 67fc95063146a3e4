"""A recording as tables for other programs: Parquet and CSV, with units."""
