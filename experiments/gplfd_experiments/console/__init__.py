"""Command line: checks of arguments, progress."""
