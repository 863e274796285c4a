"""Learning of a skill from a correction.

A correction shows one door. A permanent via-point would bend the movement at all doors
towards this door. Therefore via-points are used to complete the correction to a whole
motion at its door, which is added to the demonstrations.
"""

import warnings
from dataclasses import replace

import numpy as np

from gplfd_env.spatial.rotation_paths import unwrap_rotvecs
from gplfd_env.spatial.se3 import into_axes
from gplfd_policies.arrays.resolution import interpolated
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.correction import Correction
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.movements.movement import Movement
from gplfd_policies.movements.skill import Skill
from gplfd_policies.registry.method import Method, TrainingInput


def add_correction(method: Method, movement: Movement, correction: Correction) -> Skill:
    """Learn again from a skill's demonstrations and a completed correction."""
    if not isinstance(movement, Skill):
        raise ValueError(
            f"corrections are added to a Skill, got a {type(movement).__name__}"
        )
    whole = completed(method, movement, correction)
    demonstrations = (*as_demonstrations(movement.aligned), whole)
    with warnings.catch_warnings():
        # The first learning has already warned about the demonstrations.
        warnings.simplefilter("ignore", UserWarning)
        learned = method.learn(TrainingInput(demonstrations=demonstrations))
    if not isinstance(learned, Skill):
        raise TypeError(f"the method learned a {type(learned).__name__}, not a Skill")
    return replace(learned, corrections=(*movement.corrections, correction))


def completed(method: Method, skill: Skill, correction: Correction) -> Demonstration:
    """Return the motion of a correction, continued by the expectation of the skill.

    The skill observes the motion as in an episode: it is conditioned on via-points at
    the estimated phases of the hand, with the noise of the led hand. If the motion ends
    before the demonstrations, the conditioned mean follows, displaced so that it begins
    at the last pose, with the last wrench.
    """
    config = replace(method.config, via_std=correction.std)
    agent = replace(method, config=config).follow(skill)
    motion, phase = correction.motion, 0.0
    felt = motion.wrenches
    wrenches = np.zeros_like(motion.poses) if felt is None else -felt
    agent.reset({"ee_pose": motion.poses[0]})
    for pose, wrench in zip(motion.poses, wrenches, strict=True):
        phase = float(agent.act({"ee_pose": pose, "wrench": wrench}).observed_phase)
    expected = agent.forecast()
    after = (expected.times > phase) & (expected.times <= skill.aligned.end)
    last = interpolated(np.array([phase]), expected.times, expected.mean)
    later = skill.duration * (expected.times[after] - phase)
    poses = [motion.poses, expected.mean[after] + (motion.poses[-1] - last)]
    whole = np.vstack(poses)
    whole[:, 3:] = unwrap_rotvecs(whole[:, 3:])
    if felt is not None:
        felt = np.vstack([felt, np.repeat(felt[-1:], len(later), axis=0)])
    times = np.concatenate([motion.times, motion.times[-1] + later])
    return Demonstration(times=times, poses=whole, wrenches=felt)


def as_demonstrations(aligned: AlignedDemonstrations) -> tuple[Demonstration, ...]:
    """Return aligned demonstrations as demonstrations with common time stamps."""
    phases = np.linspace(0.0, aligned.end, len(aligned.times))
    demonstrations = []
    for number, curves in enumerate(aligned.poses):
        poses = interpolated(phases, aligned.times, curves)
        wrenches = None
        if aligned.wrenches is not None and np.isfinite(aligned.wrenches[number]).all():
            forces = interpolated(phases, aligned.times, aligned.wrenches[number])
            forces = forces.reshape(-1, 2, 3)
            wrenches = into_axes(-poses[:, None, 3:], forces).reshape(-1, 6)
        motion = {"times": aligned.duration * phases, "poses": poses}
        demonstrations.append(Demonstration(**motion, wrenches=wrenches))
    return tuple(demonstrations)
