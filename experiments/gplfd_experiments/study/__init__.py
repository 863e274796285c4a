"""Studies: policies × doors × seeds as tasks, run on any engine, resumable."""
