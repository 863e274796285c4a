"""Constants of the task, reset options, where the assets lie."""
