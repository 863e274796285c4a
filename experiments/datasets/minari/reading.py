"""Reading a data set that this package wrote."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import gymnasium as gym
import numpy as np

from experiments.datasets.minari.episode import PHYSICS_STATE, Episode
from experiments.datasets.minari.writing import (
    DATA,
    KIND,
    LAYOUT,
    MAIN_FILE,
    METADATA_FILE,
    REPRODUCING,
)

_NAMESPACE: Final = "gplfd/"


@dataclass(frozen=True, kw_only=True, slots=True)
class Dataset:
    """A data set on disk; episodes are read when asked for."""

    path: Path
    """Its folder."""
    name: str
    """Its Minari id."""
    policy: str
    """Name of the policy that acted."""
    environment: str
    """Id of the environment."""
    arguments: Mapping[str, Any]
    """Arguments of ``gym.make`` besides the id."""
    origin: Mapping[str, Any]
    """Versions, processor, command, settings and source state of the recording."""
    n_episodes: int
    """Number of episodes."""

    def make_environment(self) -> gym.Env[Any, Any]:
        """Make the environment anew.

        Only environments of this package are made, by their id: a file from elsewhere
        cannot name code to run.

        Raises:
            ValueError: The id or its arguments are unknown to the installed version.
        """
        import gplfd_env  # noqa: F401 - registers the ids

        try:
            return gym.make(self.environment, **self.arguments)
        except (gym.error.Error, TypeError, ValueError) as error:
            raise ValueError(
                f"{self.path}: the installed gplfd cannot make {self.environment} with "
                f"{dict(self.arguments)}: {error}"
            ) from error

    def check(self, numbers: Iterable[int]) -> None:
        """Raise unless these episodes exist.

        Raises:
            ValueError: One does not.
        """
        for number in numbers:
            if not 0 <= number < self.n_episodes:
                raise ValueError(
                    f"{self.path} has no episode {number}; its episodes are 0 to "
                    f"{self.n_episodes - 1}"
                )

    def episode(self, number: int) -> Episode:
        """Read an episode.

        Raises:
            ValueError: There is no such episode, or it is incomplete.
        """
        import h5py

        self.check([number])
        file = self.path / DATA / MAIN_FILE
        with _complaints(file), h5py.File(file, "r") as main:
            return _episode(main[f"episode_{number}"])


def open_dataset(path: str | Path) -> Dataset:
    """Open a data set.

    Args:
        path: Its folder, or the folder ``data`` in it.

    Raises:
        FileNotFoundError: There is no data set.
        ValueError: It is damaged, of another kind, or Minari is not installed.
    """
    folder = Path(path)
    if not (folder / DATA).is_dir() and (folder / METADATA_FILE).is_file():
        folder = folder.absolute().parent
    data = folder / DATA
    for file in (data / METADATA_FILE, data / MAIN_FILE):
        if not file.is_file():
            raise FileNotFoundError(
                f"{path} is not a data set: there is no {file.relative_to(folder)} in "
                "it; give the folder that `gplfd demos record` wrote"
            )
    try:
        import h5py
    except ImportError as error:
        raise ValueError(
            "h5py is not installed; data sets need pip install 'gplfd[minari]'"
        ) from error
    with _complaints(folder):
        metadata = json.loads((data / METADATA_FILE).read_text(encoding="utf-8"))
        _check_kind(metadata)
        with h5py.File(data / MAIN_FILE, "r") as main:
            n_episodes = len(main)
        if n_episodes != metadata["total_episodes"]:
            promised = metadata["total_episodes"]
            raise ValueError(f"{n_episodes} of {promised} episodes are in the file")
        environment, arguments = _environment(json.loads(metadata["env_spec"]))
        return Dataset(
            path=folder,
            name=metadata["dataset_id"],
            policy=metadata["algorithm_name"],
            environment=environment,
            arguments=arguments,
            origin={"minari": metadata["minari_version"], **metadata[KIND]},
            n_episodes=n_episodes,
        )


def _check_kind(metadata: Mapping[str, Any]) -> None:
    if KIND not in metadata:
        raise ValueError(
            "this data set was not recorded by `gplfd demos record`; it lacks the "
            "physics states that a replay needs"
        )
    layout = metadata[KIND]["layout"]
    if layout != LAYOUT:
        raise ValueError(
            f"the data set has layout {layout}, this gplfd reads {LAYOUT}; record it "
            "again or install the version of gplfd that wrote it"
        )
    versions = metadata[KIND]["versions"]
    missing = [name for name in REPRODUCING if name not in versions]
    if missing:
        raise ValueError(
            f"the data set does not say with which {', '.join(missing)} it was made"
        )


def _environment(spec: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    name = spec["id"]
    if not name.startswith(_NAMESPACE):
        raise ValueError(
            f"the data set was recorded in {name}, which is no environment of gplfd"
        )
    arguments = dict(spec["kwargs"])
    if spec["max_episode_steps"] is not None:
        arguments["max_episode_steps"] = spec["max_episode_steps"]
    return name, arguments


def _episode(group: Any) -> Episode:
    entries = {name: _plain(value) for name, value in group.attrs.items()}
    infos = _values(group["infos"])
    episode = Episode(
        seed=entries["seed"],
        options=_nested(entries).get("options", {}),
        observations=_values(group["observations"]),
        actions=group["actions"][()],
        rewards=group["rewards"][()],
        terminations=group["terminations"][()],
        truncations=group["truncations"][()],
        infos=infos,
        state_layout=json.loads(entries[f"{KIND}/state_layout"]),
        model_digests=json.loads(entries[f"{KIND}/model_digests"]),
    )
    rows, width = episode.states.shape
    if rows != len(episode) + 1 or width != sum(episode.state_layout.values()):
        raise ValueError(
            f"an episode of {len(episode)} steps has {rows} physics states of {width} "
            f"numbers in {PHYSICS_STATE}"
        )
    return episode


def _values(group: Any) -> dict[str, Any]:
    """Arrays by name; text as an array of str."""
    import h5py

    values: dict[str, Any] = {}
    for name, item in group.items():
        if isinstance(item, h5py.Group):
            values[name] = _values(item)
        elif h5py.check_string_dtype(item.dtype) is not None:
            values[name] = np.array([text.decode() for text in item[()]])
        else:
            values[name] = item[()]
    return values


def _plain(value: Any) -> Any:
    """A NumPy scalar or array as Python's own."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _nested(flat: Mapping[str, Any]) -> dict[str, Any]:
    """Undo Minari's ``a/b/c`` names."""
    nested: dict[str, Any] = {}
    for name, value in flat.items():
        *above, last = name.split("/")
        inner = nested
        for key in above:
            inner = inner.setdefault(key, {})
        inner[last] = value
    return nested


@contextlib.contextmanager
def _complaints(path: Path) -> Iterator[None]:
    """Say of what a reading library complains about that this file is damaged."""
    try:
        yield
    except KeyError as error:
        raise ValueError(f"{path} is incomplete: {error.args[0]}") from error
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise ValueError(f"{path}: {error}") from error
