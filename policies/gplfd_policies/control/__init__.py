"""Stiffness from uncertainty, its stability, the load, and the admittance."""
