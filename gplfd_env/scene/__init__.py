"""Door and arena in MuJoCo, and the scene that joins them with the robot."""
