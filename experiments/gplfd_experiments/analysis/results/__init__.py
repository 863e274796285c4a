"""The result files of a study as records, grouped, measured and compared."""
