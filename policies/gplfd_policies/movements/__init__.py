"""What a method learns: distributions over poses at any phase."""
