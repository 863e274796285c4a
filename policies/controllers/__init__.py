"""Stiffness from uncertainty, its stability, and the admittance it drives."""
