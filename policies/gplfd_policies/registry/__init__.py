"""Policies by name: built-in ones, the user's, and their tuning spaces."""
