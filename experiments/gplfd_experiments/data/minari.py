"""Episodes as Minari data sets, with MuJoCo's physics state at every step."""

import copy
import dataclasses
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import gymnasium as gym
import mujoco
import numpy as np
from numpy.typing import NDArray

import gplfd_env  # noqa: F401 - registers the ids
from gplfd_experiments.files.folders import check_replaceable, complete_folder
from gplfd_experiments.files.libraries import optional_libraries
from gplfd_experiments.files.plain_data import entry, naming, parsed_json, read_json
from gplfd_experiments.files.provenance import provenance
from gplfd_experiments.files.table import Table, text_table

with optional_libraries("data sets need Minari and h5py", "minari"):
    import h5py  # noqa: F401 - Minari's storage needs it
    import minari
    from minari.data_collector.episode_buffer import EpisodeBuffer
    from minari.dataset.minari_storage import MinariStorage

STATE: Final = int(mujoco.mjtState.mjSTATE_INTEGRATION)
"""All input of a step; MuJoCo continues from it bit for bit."""
PHYSICS_STATE: Final = "physics_state"  # Name of the physics state among the infos.
_KIND: Final = "gplfd"  # Name of this package's own entries of a data set.
_METADATA: Final = "data/metadata.json"
_STEPPED: Final = ("actions", "rewards", "terminations", "truncations")
_ARRAYS: Final = ("observations", "infos", *_STEPPED)  # Of an episode.
_REPRODUCING: Final = ("gplfd", "mujoco", "gymnasium", "numpy", "scipy")
"""Distributions whose versions can change what an environment computes."""
_ID: Final = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]*-v[0-9]+")


def outcome(episode: EpisodeBuffer) -> str:
    """How an episode ended: "opened", "stalled", "time limit", ..."""
    if episode.infos["success"][-1]:
        return "opened"
    failure = episode.infos["failure"][-1]  # Bytes in HDF5.
    text = failure.decode() if isinstance(failure, bytes) else failure
    return text.replace("_", " ") or "time limit"


class Recorder(gym.Wrapper[Any, Any, Any, Any]):
    """Records an episode of an environment of this package; read `episode` after it.

    Its infos include `PHYSICS_STATE`, MuJoCo's state [SI] after the reset and every
    step. (`minari.DataCollector` needs JAX.)
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self._reset: dict[str, Any] = {}
        self._seen: list[dict[str, Any]] = []
        self._steps: list[dict[str, Any]] = []

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Reset the environment with a seed and begin a new recording."""
        options = dict(options or {})
        observation, info = self.env.reset(seed=seed, options=options or None)
        self._reset = {"seed": seed, "options": _plain(options)}
        self._seen, self._steps = [], []
        self._keep(observation, info)
        return observation, info

    def step(self, action: NDArray[Any]) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment and store a row."""
        taken = np.array(action, dtype=np.float64)
        observation, reward, terminated, truncated, info = self.env.step(action)
        results = (taken, float(reward), terminated, truncated)
        self._steps.append(dict(zip(_STEPPED, results, strict=True)))
        self._keep(observation, info)
        return observation, reward, terminated, truncated, info

    @property
    def episode(self) -> EpisodeBuffer:
        """Everything since the last reset, of at least one step."""
        parts = _stacked(self._seen) | _stacked(self._steps)
        return EpisodeBuffer(**self._reset, **parts)

    def _keep(self, observation: Mapping[str, Any], info: Mapping[str, Any]) -> None:
        inner: Any = self.unwrapped
        state = np.empty(mujoco.mj_stateSize(inner.model, STATE))
        mujoco.mj_getState(inner.model, inner.data, state, STATE)
        infos = {**info, PHYSICS_STATE: state}
        self._seen.append(copy.deepcopy({"observations": observation, "infos": infos}))


def _stacked(rows: list[Any]) -> Any:
    """Return one array per name, nested as the rows are; texts as HDF5 stores them."""
    if isinstance(rows[0], Mapping):
        return {name: _stacked([row[name] for row in rows]) for name in rows[0]}
    array = np.array(rows)
    return array.tolist() if array.dtype.kind == "U" else array


def _plain(value: Any) -> Any:
    """Return nested options as HDF5 stores them, without None and NumPy's types."""
    if isinstance(value, Mapping):
        return {name: _plain(part) for name, part in value.items() if part is not None}
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def write_dataset(
    folder: str | Path,
    episodes: Iterable[EpisodeBuffer],
    *,
    env: gym.Env[Any, Any],
    policy: str,
    config: Mapping[str, Any],
    overwrite: bool = False,
) -> None:
    """Write a data set; ``folder`` appears after the last episode.

    Its name is the id by which Minari finds it if ``MINARI_DATASETS_PATH`` is the
    folder above. Minari's ``recover_environment`` makes ``env`` again. ValueError: the
    name is no id, the folder exists, or there is no episode.
    """
    target = Path(folder).absolute()
    if not _ID.fullmatch(target.name):
        raise ValueError(
            f"{target}: a data set's folder is named after its Minari id, letters, "
            "digits, _ and - with a version at the end, for example door-opening-v0"
        )
    check_replaceable(target, _METADATA, "data set", overwrite=overwrite)
    with complete_folder(target, replace=overwrite) as whole:
        whole.mkdir()
        storage = MinariStorage.new(
            whole / "data", env.observation_space, env.action_space, env.spec
        )
        doors = set()
        for number, episode in enumerate(episodes):
            doors.add(repr(episode.options.get("door")))
            storage.update_episodes([dataclasses.replace(episode, id=number)])
        if not doors:
            raise ValueError("a data set needs at least one episode; none was added")
        description = "Door opening, recorded by gplfd."
        if len(doors) > 1:
            description += (
                f" It holds {len(doors)} doors, and recover_environment() makes one: "
                "reset it with the options of an episode to have that episode's door."
            )
        origin = provenance(config)
        versions = origin["versions"]
        storage.update_metadata(
            {
                "dataset_id": target.name,
                "algorithm_name": policy,
                "description": description,
                "minari_version": minari.__version__,
                "requirements": [f"{name}=={versions[name]}" for name in _REPRODUCING],
                _KIND: origin,
            }
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class Dataset:
    """A data set on disk; episodes are read on request."""

    path: Path
    stored: Any  # The data set as Minari opens it.
    policy: str  # Name of the policy that acted.
    environment: str
    arguments: Mapping[str, Any]
    """Id of the environment, and the other arguments of ``gym.make``."""
    origin: Mapping[str, Any]
    """Versions, processor, command, settings and source state of the recording."""

    @property
    def n_episodes(self) -> int:
        """Number of episodes in it."""
        return len(self.stored)

    def make_environment(self) -> gym.Env[Any, Any]:
        """Make the environment anew; raise ValueError if this version cannot."""
        try:
            # By its spec, because Gymnasium warns about an id with a newer version.
            return gym.make(gym.spec(self.environment), **self.arguments)
        except (gym.error.Error, TypeError, ValueError) as error:
            raise ValueError(
                f"{self.path}: {self.environment} cannot be made again: {error!s:.300}"
            ) from error

    def contents(self, columns: int | None = None) -> str:
        """Return the origin, and a line per episode of some columns, or of all."""
        rows = []
        for number in range(self.n_episodes):
            episode = self.episode(number)
            infos = episode.infos
            row = {
                "episode": str(number),
                "radius [m]": f"{infos['door_radius'][-1]:.3f}",
                "time [s]": f"{episode.observations['time'][-1, 0]:.2f}",
                "angle [deg]": f"{math.degrees(infos['door_angle'][-1]):.1f}",
                "outcome": outcome(episode),
                "seed": str(episode.seed),
                "steps": str(len(episode.rewards)),
                "return": f"{episode.rewards.sum():.3f}",
            }
            rows.append(row)
        command = " ".join(entry(self.origin, "command", tuple[str, ...]))
        versions = entry(self.origin, "versions", dict[str, str])
        return (
            f"{self.stored.id}: policy {self.policy} in {self.environment}, "
            f"{self.n_episodes} episodes\n"
            f"{self.stored.storage.metadata['description']}\n"
            f"recorded {entry(self.origin, 'created', str)} by `{command}`\n"
            f"{', '.join(map(' '.join, versions.items()))}\n\n"
            f"{text_table(Table.of(rows), columns)}"
        )

    def episode(self, number: int) -> EpisodeBuffer:
        """Read an episode of T steps; raise ValueError if it is damaged.

        Observations and infos have T + 1 rows; the first is from the reset.
        """
        try:
            (metadata,) = self.stored.storage.get_episode_metadata([number])
            arrays = {name: getattr(self.stored[number], name) for name in _ARRAYS}
            options = _plain(metadata.get("options", {}))
            return EpisodeBuffer(seed=metadata["seed"], options=options, **arrays)
        # h5py and Minari raise errors of every kind for damaged files.
        except Exception as error:
            raise ValueError(
                f"{self.path}: episode {number} cannot be read: {error!s:.300}"
            ) from error


def open_dataset(path: str | Path) -> Dataset:
    """Open a data set of ``gplfd demos record``; raise ValueError for another."""
    folder = Path(path)
    if not (folder / _METADATA).is_file():
        raise FileNotFoundError(
            f"{path} is not a data set: there is no {_METADATA} in it; give the folder "
            "that `gplfd demos record` wrote"
        )
    metadata = read_json(folder / _METADATA)
    with naming(folder):
        if _KIND not in metadata:
            raise ValueError("this was not recorded by `gplfd demos record`")
        # Without spaces, Minari makes the environment, which can be any code.
        for name in ("observation_space", "action_space"):
            entry(metadata, name, str)
        spec = parsed_json(entry(metadata, "env_spec", str))
        environment = entry(spec, "id", str)
        if not (environment.startswith("gplfd/") and environment in gym.registry):
            raise ValueError(f"{environment} is no environment of gplfd")
        limit = {"max_episode_steps": entry(spec, "max_episode_steps", int | None)}
        arguments = entry(spec, "kwargs", dict[str, Any]) | _plain(limit)
        try:
            stored = minari.MinariDataset(folder / "data")
        except Exception as error:
            raise ValueError(f"Minari cannot open it: {error!s:.300}") from error
        return Dataset(
            path=folder,
            stored=stored,
            policy=entry(metadata, "algorithm_name", str),
            environment=environment,
            arguments={n: arguments[n] for n in arguments if n != "render_mode"},
            origin=entry(metadata, _KIND, dict[str, Any]),
        )
