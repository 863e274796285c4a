"""Tuning every method alike: one objective, one budget, doors that no study uses."""
