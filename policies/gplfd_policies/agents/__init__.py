"""What acts in an episode: alone, in lockstep, reaching first, or from a model."""
