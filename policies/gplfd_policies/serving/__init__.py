"""A policy as a process of its own: observations in, commands out, line by line."""
