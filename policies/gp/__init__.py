"""Gaussian-process regression for demonstrations that share their time stamps."""
