"""Motions, demonstrations and episodes in files, and the synthetic human."""
