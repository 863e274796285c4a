"""The robot: model, gripper, stance, placement before the door, driving base."""
