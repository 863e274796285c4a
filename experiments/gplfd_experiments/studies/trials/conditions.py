"""Conditions of the protocol for policies that learn elsewhere."""

from typing import Final

from gplfd_env.envs.waypoints import Condition
from gplfd_experiments.studies.trials.protocol import TRACKS, named_trials, trial_tasks

_ARGUMENTS: Final = ("randomization", "disturbance", "base", "robot", "start")


def protocol_conditions() -> list[Condition]:
    """Return every door of every trial and level in which the hand holds the handle.

    The suites of a condition are its tracks. Conditions with practice are left out.
    """
    return [
        Condition(
            name=f"{task.trial}/{task.level}/{task.door}",
            suites=tuple(t for t, of in TRACKS.items() if task.trial in of.trials),
            door=task.door,
            arguments={"door": dict(task.door_config)}
            | {name: getattr(task, name) for name in _ARGUMENTS},
        )
        for task in trial_tasks(named_trials(()), only=("oracle",), seeds=1)
        if task.start == "grasped" and task.practice is None
    ]
