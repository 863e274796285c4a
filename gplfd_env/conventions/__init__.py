"""Constants of the task, reset options, location of the assets."""
