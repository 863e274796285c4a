"""Constants of the task, reset options, geom attributes, where the assets lie."""
