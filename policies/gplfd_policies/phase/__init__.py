"""Estimation of the phase of an observed pose."""
