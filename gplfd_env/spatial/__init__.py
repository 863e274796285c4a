"""SE(3): pose vectors, rotation paths, the arc of a handle."""
