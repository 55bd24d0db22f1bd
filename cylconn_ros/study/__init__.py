"""Many simulations or many recordings: one task a row, one record a row, in a Parquet dataset."""
