"""Trials: named test conditions that measure the effect of an idea at a door."""
