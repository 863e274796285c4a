"""Checks of values that a user gives: units, ranges and names of fields."""
