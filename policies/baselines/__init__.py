"""Policies that the Gaussian-process agent is compared with."""
