"""Demonstrations of a person who leads the simulated hand."""
