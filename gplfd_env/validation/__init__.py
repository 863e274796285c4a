"""Units, ranges and names of fields: what a user gives is checked here."""
