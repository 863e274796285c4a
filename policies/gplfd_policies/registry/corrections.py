"""How a policy of skills learns from a correction.

A correction shows one door. A via-point that was kept for good would bend the movement
at all doors towards that one. The via-points therefore complete the correction to a
whole motion at its door, and the motion is added to the demonstrations: the skill then
knows that there are such doors, and how often they were met.
"""

from dataclasses import replace

import numpy as np

from gplfd_env.spatial.rotation_paths import unwrap_rotvecs
from gplfd_env.spatial.se3 import into_axes
from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.correction import Correction
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.movements.movement import Movement
from gplfd_policies.movements.skill import Skill
from gplfd_policies.registry.method import Method, TrainingInput


@one_thread
def add_correction(method: Method, movement: Movement, correction: Correction) -> Skill:
    """Learn again from a skill's demonstrations and a correction, made whole.

    Raises:
        ValueError: If the movement is no skill, or the correction does not begin at
            the closed door.
    """
    if not isinstance(movement, Skill):
        raise ValueError(
            f"corrections are added to a Skill, got a {type(movement).__name__}"
        )
    whole = completed(method, movement, correction)
    learned = method.learn(
        TrainingInput(demonstrations=(*demonstrated(movement.aligned), whole))
    )
    if not isinstance(learned, Skill):
        raise TypeError(f"the method learned a {type(learned).__name__}, not a Skill")
    return replace(learned, corrections=(*movement.corrections, correction))


def completed(method: Method, skill: Skill, correction: Correction) -> Demonstration:
    """Return the motion of a correction, and what the skill expects to follow it.

    The skill observes the motion as it does in an episode: it is conditioned on
    via-points at the phases at which it finds the hand, with the noise of the led hand
    (`Correction.std`). Where the motion ends before the demonstrations do, the
    conditioned mean follows, displaced so that it begins at the last pose.
    """
    config = replace(method.config, via_std=correction.std)
    agent = replace(method, config=config).follow(skill)
    motion, phase = correction.motion, 0.0
    rest = np.zeros((len(motion.poses), 6))
    wrenches = rest if motion.wrenches is None else -motion.wrenches
    agent.reset({"ee_pose": motion.poses[0], "wrench": wrenches[0]})
    for pose, wrench in zip(motion.poses, wrenches, strict=True):
        step = agent.act({"ee_pose": pose, "wrench": wrench})
        phase = float(step.observed_phase)
    expected, end = agent.forecast(), skill.aligned.end
    after = (expected.times > phase) & (expected.times <= end)
    if not after.any():
        return motion
    last = [np.interp(phase, expected.times, curve) for curve in expected.mean.T]
    poses = expected.mean[after] + (motion.poses[-1] - last)
    times = motion.times[-1] + skill.duration * (expected.times[after] - phase)
    poses = np.vstack([motion.poses, poses])
    poses[:, 3:] = unwrap_rotvecs(poses[:, 3:])
    felt = None
    if motion.wrenches is not None:
        # What the hand bears last, it goes on to bear.
        still = np.repeat(motion.wrenches[-1:], np.count_nonzero(after), axis=0)
        felt = np.vstack([motion.wrenches, still])
    return Demonstration(
        times=np.concatenate([motion.times, times]), poses=poses, wrenches=felt
    )


def demonstrated(aligned: AlignedDemonstrations) -> tuple[Demonstration, ...]:
    """Return aligned demonstrations as demonstrations on their common clock."""
    phases = np.linspace(0.0, aligned.end, len(aligned.times))

    def shown(curves: np.ndarray) -> np.ndarray:
        columns = [np.interp(phases, aligned.times, curve) for curve in curves.T]
        return np.column_stack(columns)

    found = []
    for number, given in enumerate(aligned.poses):
        poses, wrenches = shown(given), None
        if aligned.wrenches is not None and np.isfinite(aligned.wrenches[number]).all():
            own = shown(aligned.wrenches[number]).reshape(-1, 2, 3)
            wrenches = into_axes(-poses[:, None, 3:], own).reshape(-1, 6)
        found.append(
            Demonstration(
                times=aligned.duration * phases, poses=poses, wrenches=wrenches
            )
        )
    return tuple(found)
