"""Your own policy at the same doors, logged and evaluated like the others.

gplfd run --policy examples/your_own_policy.py:make
"""

import numpy as np


class Imitate:
    """Follows the demonstrations from the demonstrated pose nearest to the hand."""

    def __init__(self, demonstrations):
        paths = [each.poses for each in demonstrations]  # (N, 6), 60 samples per second
        self.poses = np.concatenate([path[:-50] for path in paths])
        self.steps = np.concatenate([path[50:] - path[:-50] for path in paths])

    def act(self, observation):
        hand = observation["ee_pose"]  # x, y, z [m] and rotation vector [rad]
        distances = np.linalg.norm(self.poses - hand, axis=1)
        step = self.steps[np.argsort(distances)[:30]].mean(axis=0)
        return hand + 0.007 * step / np.linalg.norm(step[:3])  # 7 mm ahead of the hand


def make(training):
    """Nearest neighbours among the demonstrated poses."""
    return Imitate(training.demonstrations)
