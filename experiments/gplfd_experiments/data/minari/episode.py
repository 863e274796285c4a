"""One episode with all data that is needed to repeat it.

A step depends only on MuJoCo's physics state and its model.
"""

import dataclasses
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, cast

import gymnasium as gym
import mujoco
import numpy as np
from numpy.typing import NDArray

from gplfd_experiments.files.arrays import FloatArray

Array = NDArray[Any]

STATE: Final = int(mujoco.mjtState.mjSTATE_INTEGRATION)
"""All input of a step; MuJoCo continues from it bit for bit."""
PHYSICS_STATE: Final = "physics_state"
"""Name of the physics state among the infos."""

_OUTCOME: Final = {
    "door_angle": "f",
    "door_radius": "f",
    "success": "b",
    "failure": "U",
}
"""Infos about the end of an episode, and NumPy's kinds of their arrays."""
_HASHED_STRUCTS: Final = ("opt", "stat")
_DIGITS: Final = 16


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordedEpisode:
    """Input and output of an environment in one episode.

    T is the number of steps. Observations and infos have T + 1 rows, the first one from
    the reset; the others T.

    Raises:
        ValueError: There is no step, something is missing, or an array has another
            number of rows or holds neither numbers nor text.
    """

    seed: int
    """Seed of the reset."""
    options: Mapping[str, Any]
    """Effective options: of this and earlier resets of the same environment."""
    observations: Mapping[str, Array]
    """Observations by name, (T + 1, ...)."""
    actions: Array
    """Actions that the agent took, (T, A)."""
    rewards: Array
    """Rewards of the steps, (T,)."""
    terminations: Array
    """Whether the task ended at this step, (T,)."""
    truncations: Array
    """Whether the episode was truncated at this step, (T,)."""
    infos: Mapping[str, Array]
    """The environment's infos by name, parts of nested ones by ``name/part``,
    (T + 1, ...), and `PHYSICS_STATE`, (T + 1, S): MuJoCo's state [SI] after the reset
    and after every step."""
    state_layout: Mapping[str, int]
    """Parts of the physics state and their lengths, in order; they add up to S."""
    model_digests: Mapping[str, str]
    """Hashes of the model after the reset, by part."""

    def __post_init__(self) -> None:
        steps = np.size(self.rewards)
        rows = steps + 1
        for name in ("rewards", "terminations", "truncations"):
            _check(name, getattr(self, name), (steps,))
        _check("actions", self.actions, (steps, *np.shape(self.actions)[1:]))
        for name, array in self.observations.items():
            _check(f"observation {name}", array, (rows, *np.shape(array)[1:]))
        for name, array in self.infos.items():
            _check(f"info {name}", array, (rows, *np.shape(array)[1:]), "biufU")
        for name, kind in _OUTCOME.items():
            _check(f"info {name}", self.infos.get(name), (rows,), kind)
        _check("observation time", self.observations.get("time"), (rows, 1))
        width = sum(self.state_layout.values())
        _check(f"info {PHYSICS_STATE}", self.infos.get(PHYSICS_STATE), (rows, width))

    def __len__(self) -> int:
        """Return the number of steps T."""
        return len(self.rewards)

    @property
    def states(self) -> Array:
        """Physics states, (T + 1, S)."""
        return self.infos[PHYSICS_STATE]

    @property
    def outcome(self) -> str:
        """How it ended: "opened", "stalled", "time limit", ..."""
        if self.infos["success"][-1]:
            return "opened"
        return str(self.infos["failure"][-1]).replace("_", " ") or "time limit"


class Recorder(gym.Wrapper[Any, Any, Any, Any]):
    """Records the data between an agent and an environment of this package.

    Wrap the environment, run an episode, and read `episode` before the next reset.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self._start: dict[str, Any] = {}
        self._in_force: dict[str, Any] = {}
        self._observations: list[dict[str, Any]] = []
        self._infos: list[dict[str, Any]] = []
        self._actions: list[Array] = []
        self._results: list[tuple[float, bool, bool]] = []

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Reset the environment and begin a new recording.

        Raises:
            ValueError: No seed is given: the episode could not be run again.
        """
        if seed is None:
            raise ValueError(
                "a recorded episode needs a seed, or it cannot be run again; call "
                "reset(seed=...)"
            )
        given = dict(options or {})
        observation, info = self.env.reset(seed=seed, options=given or None)
        # Options of an earlier reset stay in force.
        self._in_force |= _storable(given)
        model = cast(Any, self.unwrapped).model
        self._start = {
            "seed": seed,
            "options": dict(self._in_force),
            "state_layout": state_layout(model),
            "model_digests": model_digests(model),
        }
        for rows in (self._observations, self._infos, self._actions, self._results):
            rows.clear()
        self._keep(observation, info)
        return observation, info

    def step(self, action: Array) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment and store a row."""
        given = np.array(action, dtype=np.float64)
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._actions.append(given)
        self._results.append((float(reward), terminated, truncated))
        self._keep(observation, info)
        return observation, reward, terminated, truncated, info

    @property
    def episode(self) -> RecordedEpisode:
        """Everything since the last reset.

        Raises:
            ValueError: There was no step yet, or an info cannot be kept as an array.
        """
        if not self._results:
            raise ValueError("nothing is recorded yet; reset, then step at least once")
        rewards, terminations, truncations = zip(*self._results, strict=True)
        return RecordedEpisode(
            **self._start,
            observations=_stack("observation", self._observations),
            actions=np.array(self._actions),
            rewards=np.array(rewards),
            terminations=np.array(terminations),
            truncations=np.array(truncations),
            infos=_stack("info", self._infos),
        )

    def _keep(self, observation: Mapping[str, Any], info: Mapping[str, Any]) -> None:
        inner: Any = self.unwrapped
        for rows, given in ((self._observations, observation), (self._infos, info)):
            rows.append({name: np.copy(one)[()] for name, one in flat(given).items()})
        self._infos[-1][PHYSICS_STATE] = physics_state(inner.model, inner.data)


def _check(name: str, array: Any, shape: tuple[int, ...], kinds: str = "biuf") -> None:
    """Raise ValueError unless an array has a shape and one of NumPy's kinds."""
    if array is None:
        raise ValueError(f"{name} is missing")
    if array.dtype.kind not in kinds:
        raise ValueError(f"{name} is {array.dtype}, no array of numbers or text")
    if array.shape != shape or array.size == 0:
        raise ValueError(f"{name} has shape {array.shape}, must have {shape}")


def _storable(value: Any) -> Any:
    """Return options with records as mappings, which resets also accept."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = dataclasses.asdict(value)
    if not isinstance(value, Mapping):
        return value
    return {name: _storable(part) for name, part in value.items() if part is not None}


def flat(values: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Return nested mappings as one with names ``a/b/c``, as in Minari."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            found |= flat(value, f"{above}{name}/")
        else:
            found[above + name] = value
    return found


def _stack(what: str, rows: Sequence[Mapping[str, Any]]) -> dict[str, Array]:
    """Return one array per name, which must be in every row."""
    stacked: dict[str, Array] = {}
    for name in rows[0]:
        try:
            stacked[name] = np.array([row[name] for row in rows])
        except (KeyError, ValueError) as error:
            raise ValueError(
                f"{what} {name!r} must be in every step and keep its shape: {error}"
            ) from error
    return stacked


def physics_state(model: mujoco.MjModel, data: mujoco.MjData) -> FloatArray:
    """All input of the next step except the model, (S,) [SI]."""
    state = np.empty(mujoco.mj_stateSize(model, STATE))
    mujoco.mj_getState(model, data, state, STATE)
    return state


def state_layout(model: mujoco.MjModel) -> dict[str, int]:
    """Return the size of each part of the state, in order, without empty parts."""
    members = mujoco.mjtState.__members__.items()
    sizes = {
        name.removeprefix("mjSTATE_").lower(): mujoco.mj_stateSize(model, int(bit))
        for name, bit in sorted(members, key=lambda member: int(member[1]))
        if int(bit).bit_count() == 1 and int(bit) & STATE
    }
    return {name: size for name, size in sizes.items() if size}


def model_digests(model: mujoco.MjModel) -> dict[str, str]:
    """Hashes of the compiled model's parts, by what they describe ("geom", "opt", ...).

    Two models with equal hashes have equal numbers, bit for bit. How the model is drawn
    in general (``vis``) is left out; colours count.
    """
    contents: list[tuple[str, Any]] = []
    for name in sorted(dir(model)):
        value = None if name.startswith("_") else getattr(model, name)
        if name in _HASHED_STRUCTS:
            parts = {field: getattr(value, field) for field in sorted(dir(value))}
            contents += [
                (f"{name}_{field}", part)
                for field, part in parts.items()
                if not field.startswith("_") and not callable(part)
            ]
        elif isinstance(value, np.ndarray):
            contents.append((name, value))
    digests: dict[str, Any] = {}
    for name, value in contents:
        digest = digests.setdefault(name.split("_")[0], hashlib.sha256())
        array = np.ascontiguousarray(value)
        digest.update(f"{name} {array.dtype.str} {array.shape} ".encode())
        digest.update(array.tobytes())
    return {name: digests[name].hexdigest()[:_DIGITS] for name in sorted(digests)}


def model_hash(digests: Mapping[str, str]) -> str:
    """One hash of what `model_digests` returned."""
    text = " ".join(f"{name} {digests[name]}" for name in sorted(digests))
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]
