"""Policies by name: built-in policies, policies of users, and tuning spaces."""
