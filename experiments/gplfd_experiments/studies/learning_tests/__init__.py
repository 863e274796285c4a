"""Learning tests of methods on left-out demonstrations, without a robot."""
