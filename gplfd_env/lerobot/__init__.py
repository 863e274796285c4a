"""Doors for LeRobot's commands: ``--env.discover_packages_path=gplfd_env.lerobot``.

    lerobot-eval --env.discover_packages_path=gplfd_env.lerobot --env.type=gplfd \
        --env.task=radius/between --seed=100 --policy.path=CHECKPOINT

Needs LeRobot 0.6, and with it Python 3.12. A folder, because LeRobot looks into it.
"""

from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from typing import Any

import gymnasium as gym

from gplfd_env.conventions.constants import ActionForm
from gplfd_env.doors.config import DOORS, door_config
from gplfd_env.envs.waypoints import SIZES, Condition, WaypointDoor
from gplfd_env.robot.placement import base_for
from gplfd_env.robot.robots import robot_named
from gplfd_env.validation.named import nearest_name

try:
    from lerobot.configs import FeatureType, PolicyFeature
    from lerobot.envs import EnvConfig
except ImportError as error:
    raise ImportError(
        f"gplfd_env.lerobot needs LeRobot 0.6 ({error}), with Python 3.12 or newer; in "
        "a checkout of gplfd: pip install '.[lerobot]', elsewhere: pip install "
        "'gplfd[lerobot]'"
    ) from error

__all__ = ["DoorEnvConfig", "conditions"]

_PROTOCOL = "gplfd_experiments.studies.trials.conditions"
"""Module of the protocol's conditions. It is imported by name: the environment does not
depend on the experiments, and opens doors without them."""


def conditions(task: str, randomization: str = "none") -> dict[str, list[Condition]]:
    """Return the conditions that a text names, by suite.

    Names are separated by commas. A name is a door (a preset, or a radius [m]), a track
    of the protocol, a trial, a level ("radius/between"), or one door of it
    ("radius/between/0.42"). The randomization applies to doors. Raises a ValueError for
    an unknown name.
    """
    suites: dict[str, list[Condition]] = {}
    protocol: list[Condition] | None = None
    for name in map(str.strip, task.split(",")):
        try:
            door = name if name in DOORS else float(name)
        except ValueError:
            protocol = protocol or import_module(_PROTOCOL).protocol_conditions()
            matching = [
                condition
                for condition in protocol
                if name in condition.suites
                or f"{condition.name}/".startswith(f"{name}/")
            ]
            if not matching:
                names = {suite for condition in protocol for suite in condition.suites}
                names |= {condition.name.rpartition("/")[0] for condition in protocol}
                raise ValueError(
                    f"unknown --env.task {name!r}{nearest_name(name, sorted(names))}; "
                    f"doors, or {', '.join(sorted(names))}"
                ) from None
        else:
            base = base_for(door_config(door), robot_named("tiago-like"))
            arguments = {"door": door, "randomization": randomization, "base": base}
            matching = [Condition(name=name, door=f"{door}", arguments=arguments)]
        for condition in matching:
            suite = name if name in condition.suites else condition.suites[0]
            suites.setdefault(suite, []).append(condition)
    return suites


@EnvConfig.register_subclass("gplfd")
@dataclass
class DoorEnvConfig(EnvConfig):
    """Doors and conditions of the protocol as environments of LeRobot.

    A seed of an episode (``--seed`` is the first) is one of `gplfd benchmark` and
    `gplfd trials`: with it, the same door is drawn.
    """

    task: str | None = "medium"
    """As in `conditions`."""
    fps: int = 20
    """Actions per second; a divisor of 100, and the rate of the training data."""
    action: ActionForm = "pose"
    cameras: str = ""
    """Cameras of ``pixels``, separated by commas: overview, top, head, hand_camera."""
    width: int = 320
    height: int = 240
    randomization: str = "none"
    """Of doors that are no condition of the protocol."""
    features: dict[str, PolicyFeature] = field(default_factory=dict)
    features_map: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Describe actions and observations."""
        size, wrench = SIZES[self.action], "observation.environment_state"
        described: dict[str, tuple[str, Any, tuple[int, ...]]] = {
            "action": ("action", FeatureType.ACTION, (size,)),
            "agent_pos": ("observation.state", FeatureType.STATE, (7,)),
            "environment_state": (wrench, FeatureType.ENV, (6,)),
        }
        for camera in self._cameras:
            key, picture = f"observation.images.{camera}", (self.height, self.width, 3)
            described[f"pixels/{camera}"] = (key, FeatureType.VISUAL, picture)
        for name, (key, kind, shape) in described.items():
            self.features[name] = PolicyFeature(type=kind, shape=shape)
            self.features_map[name] = key

    @property
    def _cameras(self) -> tuple[str, ...]:
        return tuple(name.strip() for name in self.cameras.split(",") if name.strip())

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        """Arguments of a `WaypointDoor` beside the condition."""
        size = self.width, self.height
        return dict(rate=self.fps, form=self.action, cameras=self._cameras, size=size)

    def create_envs(
        self, n_envs: int, use_async_envs: bool = False
    ) -> dict[str, dict[int, Any]]:
        """Return n environments of every condition, by suite and number."""
        vector: Any = gym.vector.SyncVectorEnv
        options: dict[str, Any] = {"autoreset_mode": gym.vector.AutoresetMode.SAME_STEP}
        if use_async_envs and n_envs > 1:
            vector, options["context"] = gym.vector.AsyncVectorEnv, "forkserver"
        return {
            suite: {
                number: vector(
                    [partial(WaypointDoor, condition, **self.gym_kwargs)] * n_envs,
                    **options,
                )
                for number, condition in enumerate(matching)
            }
            for suite, matching in conditions(
                self.task or "medium", self.randomization
            ).items()
        }
