"""Recordings, demonstrations and episodes in files, and the synthetic human."""
