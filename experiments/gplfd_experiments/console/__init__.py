"""What a person gives on a command line, and sees meanwhile."""
