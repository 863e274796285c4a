"""Stepping one scene or many: commands, servo, external loads."""
