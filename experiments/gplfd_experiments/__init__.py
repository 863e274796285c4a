"""Teacher, rollouts, metrics, recordings and the ``gplfd`` command."""
