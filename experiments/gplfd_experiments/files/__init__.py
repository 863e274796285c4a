"""Plain data, tables, provenance, and folders that are complete or absent."""
