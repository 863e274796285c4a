"""How well a method learns, measured on demonstrations it did not see; no robot."""
