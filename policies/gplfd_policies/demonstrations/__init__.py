"""Demonstrations, and how they are trimmed, aligned and continued."""
