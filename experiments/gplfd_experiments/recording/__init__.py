"""Episodes as Rerun recordings: scene, policy, and reasons for the stiffness."""
