"""What a command composes of all others: a run, a skill, recordings of a study."""
