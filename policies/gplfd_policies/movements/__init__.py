"""Learned movements: distributions over poses at any phase."""
