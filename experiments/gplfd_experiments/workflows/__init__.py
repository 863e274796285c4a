"""Workflows of commands: a run, a skill, recordings of a study."""
