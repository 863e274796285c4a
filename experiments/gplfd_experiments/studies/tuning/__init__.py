"""Tuning of all methods by one objective and budget, on doors that no study uses."""
