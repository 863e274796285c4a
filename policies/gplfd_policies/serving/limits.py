"""The operator limits, enforced on every command and checked in every observation."""

import math

import numpy as np

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.spatial.se3 import compose_rotvecs, rotation_distance
from gplfd_policies.serving.settings import ServeSettings


def limited(
    settings: ServeSettings, pose: np.ndarray, stiffness: np.ndarray, last: np.ndarray
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return a command within the limits, given the last commanded pose.

    The position is moved to the nearest point of the workspace. A step that exceeds the
    speed limits is shortened along the straight line and the shortest rotation from the
    last pose (6,) [m, rad].

    Returns:
        The pose (6,) [m, rad], the same object if no limit changed it; the stiffness
        (6,) [N/m, N m/rad], NaN if unknown; and the names of the limits that changed
        them.
    """
    acted = []
    low, high = np.reshape(settings.workspace, (2, 3))
    position, rotation = pose[:3], pose[3:]
    inside = np.minimum(np.maximum(position, low), high)
    if not np.array_equal(inside, position):
        acted.append("workspace")
        position = inside
    shift = position - last[:3]
    distance, most = math.hypot(*shift), settings.linear_speed * CONTROL_PERIOD
    if distance > most:
        acted.append("linear_speed")
        position = last[:3] + shift * (most / distance)
    angle, most = rotation_distance(rotation, last[3:]), settings.angular_speed
    most *= CONTROL_PERIOD
    if angle > most:
        acted.append("angular_speed")
        turn = compose_rotvecs(rotation, -last[3:])
        rotation = compose_rotvecs(turn * (most / angle), last[3:])
    if acted:
        pose = np.concatenate([position, rotation])
    bounds = np.repeat((settings.least_stiffness, settings.greatest_stiffness), 3, 1)
    within = np.minimum(np.maximum(stiffness, bounds[0]), bounds[1])
    if not np.array_equal(within, stiffness, equal_nan=True):
        acted.append("stiffness")
        stiffness = within
    return pose, stiffness, acted


def exceeded(settings: ServeSettings, pose: np.ndarray, wrench: np.ndarray) -> str:
    """Return the limit that a measured pose or wrench exceeds, or ""."""
    low, high = np.reshape(settings.workspace, (2, 3))
    if (pose[:3] < low).any() or (pose[:3] > high).any():
        return "hand outside the workspace"
    if math.hypot(*wrench[:3]) > settings.force:
        return "measured force beyond its limit"
    if math.hypot(*wrench[3:]) > settings.moment:
        return "measured moment beyond its limit"
    return ""


def exceeds_following_error(
    settings: ServeSettings, pose: np.ndarray, command: np.ndarray
) -> bool:
    """Return whether the hand is farther from its command than the limits allow."""
    distance = math.hypot(*(pose[:3] - command[:3]))
    angle = rotation_distance(pose[3:], command[3:])
    return bool(distance > settings.follow_distance or angle > settings.follow_angle)
