"""Trials: named conditions that ask what an idea is worth on a door."""
