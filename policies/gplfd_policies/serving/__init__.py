"""A policy in its own process: receives observations, sends commands, line by line."""
