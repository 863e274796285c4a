"""Files that say what made them, written complete or not at all."""
