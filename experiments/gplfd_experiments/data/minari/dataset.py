"""Data sets on disk, written completely or not at all; only those of gplfd are read."""

import hashlib
import io
import json
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import gymnasium as gym
import h5py
import minari
import numpy as np
from minari.serialization import serialize_space
from numpy.typing import NDArray

import gplfd_env  # noqa: F401 - registers the ids
from gplfd_experiments.data.hdf5 import check_links, check_readable, member
from gplfd_experiments.data.minari.episode import RecordedEpisode, flat, model_hash
from gplfd_experiments.files.folders import check_replaceable, complete_folder
from gplfd_experiments.files.plain_data import (
    entry,
    naming,
    parsed_json,
    read_json,
    write_json,
)
from gplfd_experiments.files.provenance import content_hash, provenance
from gplfd_experiments.files.table import Table, text_table
from gplfd_policies.arrays.storage import DecodingBudget, complete_or_absent

KIND: Final = "gplfd"
"""Name of this package's own entries, per data set and episode."""

LAYOUT: Final = 2
"""Version of these entries."""

DATA, MAIN_FILE, METADATA_FILE = "data", "main_data.hdf5", "metadata.json"

PER_STEP: Final = ("actions", "rewards", "terminations", "truncations")
"""Arrays directly in an episode; the others are in its observations and infos."""

REPRODUCING: Final = ("gplfd", "mujoco", "gymnasium", "numpy", "scipy")
"""Distributions whose versions can change what an environment computes."""

_ID: Final = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]*-v[0-9]+")
_COMPACT: Final = ("v110", "v110")
"""Format of HDF5 1.10 (2016), whose indices are far smaller than the oldest's."""
_LARGEST_CHUNK: Final = 1500  # Rows that are compressed together.
_NAMESPACE: Final = "gplfd/"
_LARGEST_EPISODE: Final = 2**28
"""Largest unpacked size of an episode [bytes], that of an hour without motion."""
_TEXTS: Final = 256  # Number of texts that are read at once.
_ORIGIN: Final[Mapping[str, Any]] = {
    "created": str,
    "command": tuple[str, ...],
    "versions": dict[str, str],
    "arithmetic": dict[str, str],
    "git": dict[str, Any] | None,
    "config": dict[str, Any],
}


def write_dataset(
    folder: str | Path,
    episodes: Iterable[RecordedEpisode],
    *,
    env: gym.Env[Any, Any],
    policy: str,
    config: Mapping[str, Any],
    overwrite: bool = False,
) -> None:
    """Write a data set; ``folder`` is created after the last episode.

    Until then its compressed episodes are kept in memory, about a kilobyte per step.

    Args:
        folder: Where the data set goes. Its name is the data set's id, so
            ``MINARI_DATASETS_PATH`` set to the folder above it lets
            ``minari.load_dataset`` find it.
        episodes: At least one; iterated after the check that the folder is writable.
        env: Environment made by ``gym.make`` in which the episodes ran. Its
            specification is stored for Minari's ``recover_environment``.
        policy: Name of the policy that acted.
        config: Settings of the recording, stored as metadata; JSON-able.
        overwrite: Replace an existing data set.

    Raises:
        ValueError: The name is not an id, the folder exists, the environment's
            arguments cannot be stored, or there is no episode.
        OSError: The folder cannot be written.
    """
    target = Path(folder).absolute()
    if not _ID.fullmatch(target.name):
        raise ValueError(
            f"{target}: a data set's folder is named after its Minari id, letters, "
            "digits, _ and - with a version at the end, for example door-opening-v0"
        )
    mark = f"{DATA}/{METADATA_FILE}"
    check_replaceable(target, mark, "data set", overwrite=overwrite)
    spec = env.spec
    if spec is None:
        raise ValueError(
            "the environment must be made by gym.make, so that it can be made again"
        )
    try:
        specification = spec.to_json()
    except TypeError as error:
        raise ValueError(
            f"the arguments {spec.kwargs} of {spec.id} cannot be stored ({error}); "
            "give names, numbers or mappings instead of objects"
        ) from error
    with complete_folder(target) as whole:
        content, totals = _packed(episodes)
        origin = provenance(config)
        versions = {name: origin["versions"][name] for name in REPRODUCING}
        metadata = {
            "dataset_id": target.name,
            "env_spec": specification,
            "observation_space": serialize_space(env.observation_space),
            "action_space": serialize_space(env.action_space),
            "algorithm_name": policy,
            **totals,
            "dataset_size": round(len(content) / 1e6, 1),
            "data_format": "hdf5",
            "jpeg_encoding": False,
            "minari_version": minari.__version__,
            "requirements": [
                f"{name}=={version}"
                for name, version in versions.items()
                if version != "unknown"
            ],
            KIND: {
                "layout": LAYOUT,
                "sha256": hashlib.sha256(content).hexdigest(),
                **origin,
            },
        }
        try:
            with complete_or_absent(whole / DATA / MAIN_FILE) as path:
                path.write_bytes(content)
            write_json(whole / DATA / METADATA_FILE, metadata)
        except OSError as error:
            size = f"the data set takes {len(content) / 1e6:.1f} MB"
            reason = f"{error.strerror}; {size}"
            raise OSError(error.errno, reason, str(folder)) from error


def _packed(episodes: Iterable[RecordedEpisode]) -> tuple[bytes, dict[str, Any]]:
    """Make the HDF5 file in memory: on a full disk, HDF5 ends the process.

    Returns:
        Its content, and its metadata.
    """
    steps, doors = [], set()
    image = io.BytesIO()
    with h5py.File(image, "w", libver=_COMPACT, track_order=True) as file:
        for number, episode in enumerate(episodes):
            group = file.create_group(f"episode_{number}")
            group.attrs.update(
                {
                    "id": number,
                    "seed": episode.seed,
                    "total_steps": len(episode),
                    **flat({"options": episode.options}),
                    f"{KIND}/state_layout": json.dumps(dict(episode.state_layout)),
                    f"{KIND}/model_digests": json.dumps(dict(episode.model_digests)),
                    f"{KIND}/model_hash": model_hash(episode.model_digests),
                }
            )
            arrays = {name: getattr(episode, name) for name in PER_STEP}
            arrays |= flat({"observations": episode.observations})
            arrays |= flat({"infos": episode.infos})
            for name, array in arrays.items():
                # Compressed, because states repeat, and resizable, so that Minari can
                # append.
                text = array.dtype.kind == "U"
                group.create_dataset(
                    name,
                    data=array.tolist() if text else array,
                    dtype=h5py.string_dtype() if text else array.dtype,
                    chunks=(min(len(array), _LARGEST_CHUNK), *array.shape[1:]),
                    maxshape=(None, *array.shape[1:]),
                    compression="gzip",
                    shuffle=True,
                )
            steps.append(len(episode))
            doors.add(repr(episode.options.get("door")))
    if not steps:
        raise ValueError("a data set needs at least one episode; none was added")
    description = (
        "Door opening, recorded by gplfd; run again with `gplfd demos replay`."
    )
    if len(doors) > 1:
        description += (
            f" It holds {len(doors)} doors, and recover_environment() makes one: reset "
            "it with the options of an episode to have that episode's door."
        )
    return image.getvalue(), {
        "total_episodes": len(steps),
        "total_steps": sum(steps),
        "description": description,
    }


@dataclass(frozen=True, kw_only=True, slots=True)
class Dataset:
    """A data set on disk; episodes are read on request."""

    path: Path
    """Folder of the data set."""
    name: str
    """Minari id of the data set."""
    policy: str
    """Name of the policy that acted."""
    description: str
    """Its description."""
    environment: str
    """Id of the environment."""
    arguments: Mapping[str, Any]
    """Arguments of ``gym.make`` besides the id."""
    origin: Mapping[str, Any]
    """Versions, processor, command, settings and source state of the recording."""
    n_episodes: int
    """Number of episodes in it."""

    def make_environment(self) -> gym.Env[Any, Any]:
        """Make the environment anew.

        Only environments of this package are made, by their id, so that an untrusted
        file cannot name code to run.

        Raises:
            ValueError: The id or its arguments are unknown to the installed version.
        """
        try:
            # By its spec, because Gymnasium warns about an id with a newer version.
            return gym.make(gym.spec(self.environment), **self.arguments)
        except (gym.error.Error, TypeError, ValueError) as error:
            raise ValueError(
                f"{self.path}: the installed gplfd cannot make {self.environment} with "
                f"{dict(self.arguments)!s:.200}: {error!s:.300}"
            ) from error

    def __str__(self) -> str:
        """The data set in one line."""
        arguments = ", ".join(
            f"door of {value['radius']:g} m"
            if name == "door" and isinstance(value, Mapping) and "radius" in value
            else f"{name}={value!r}"
            for name, value in self.arguments.items()
        )
        return (
            f"{self.name}: policy {self.policy} in {self.environment}"
            f"{f' ({arguments})' if arguments else ''}, {self.n_episodes} episodes"
        )

    def contents(self) -> str:
        """Return the origin of the data set, and a line per episode.

        Raises:
            ValueError: An episode is incomplete.
        """
        origin, git = self.origin, self.origin["git"]
        rows = []
        for number in range(self.n_episodes):
            episode = self.episode(number)
            row = {
                "episode": str(number),
                "radius [m]": f"{episode.infos['door_radius'][-1]:.3f}",
                "seed": str(episode.seed),
                "steps": str(len(episode)),
                "time [s]": f"{episode.observations['time'][-1, 0]:.2f}",
                "angle [deg]": f"{math.degrees(episode.infos['door_angle'][-1]):.1f}",
                "outcome": episode.outcome,
                "return": f"{episode.rewards.sum():.3f}",
                "model": model_hash(episode.model_digests)[:8],
            }
            rows.append(row)
        recorded = f"recorded {origin['created']} by `{' '.join(origin['command'])}`"
        if git:
            edited = " with edits" if git.get("dirty") else ""
            recorded += f" at git {str(git.get('commit'))[:10]}{edited}"
        versions = {"minari": origin["minari"], **origin["versions"]}
        return "\n".join(
            [
                str(self),
                self.description,
                recorded,
                ", ".join(f"{name} {one}" for name, one in versions.items()),
                ", ".join(
                    f"{name} {one}" for name, one in origin["arithmetic"].items()
                ),
                "",
                text_table(Table.of(rows)),
            ]
        )

    def check(self, numbers: Iterable[int]) -> None:
        """Raise ValueError unless these episodes exist."""
        for number in numbers:
            if not 0 <= number < self.n_episodes:
                raise ValueError(
                    f"{self.path} has no episode {number}; its episodes are 0 to "
                    f"{self.n_episodes - 1}"
                )

    def episode(self, number: int) -> RecordedEpisode:
        """Read an episode.

        Raises:
            ValueError: There is no such episode, or it is incomplete.
        """
        self.check([number])
        try:
            file = self.path / DATA / MAIN_FILE
            budget = DecodingBudget(file.stat().st_size, least=_LARGEST_EPISODE)
            with h5py.File(file, "r") as main:
                return _episode(member(main, f"episode_{number}"), budget)
        # A correct hash does not ensure that gplfd wrote the content.
        except Exception as error:
            raise ValueError(
                f"{self.path}: episode {number} cannot be read: {error!s:.300}"
            ) from error


def open_dataset(path: str | Path) -> Dataset:
    """Open a data set after a check of its hash.

    The hash of the file of arrays detects damage: HDF5 would read a changed number as
    another number, and can hang at a changed index. The hash does not protect against a
    file that was forged together with its hash.

    Args:
        path: Folder of the data set, or the folder ``data`` in it.

    Raises:
        FileNotFoundError: There is no data set.
        OSError: It cannot be read.
        ValueError: It is damaged or of another kind.
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
    metadata = read_json(data / METADATA_FILE)
    sha256 = content_hash(data / MAIN_FILE)
    with naming(folder):
        if KIND not in metadata:
            raise ValueError(
                "this data set was not recorded by `gplfd demos record`; it lacks the "
                "physics states that a replay needs"
            )
        own = entry(metadata, KIND, dict[str, Any])
        layout = entry(own, "layout", int)
        if layout != LAYOUT:
            raise ValueError(
                f"the data set has layout {layout}, this gplfd reads {LAYOUT}; record "
                "it again or install the version of gplfd that wrote it"
            )
        if entry(own, "sha256", str) != sha256:
            raise ValueError(
                f"{DATA}/{MAIN_FILE} is damaged or was changed after it was recorded; "
                "copy or record the data set again"
            )
        origin = {name: entry(own, name, kind) for name, kind in _ORIGIN.items()}
        missing = [name for name in REPRODUCING if name not in origin["versions"]]
        if missing:
            raise ValueError(f"the data set does not state its {', '.join(missing)}")
        n_episodes = entry(metadata, "total_episodes", int)
        if n_episodes < 1:
            raise ValueError("the data set holds no episode")
        spec = parsed_json(entry(metadata, "env_spec", str))
        environment = entry(spec, "id", str)
        if not (environment.startswith(_NAMESPACE) and environment in gym.registry):
            raise ValueError(
                f"the data set was recorded in {environment}, which is no environment "
                "of gplfd"
            )
        arguments = entry(spec, "kwargs", dict[str, Any])
        limit = entry(spec, "max_episode_steps", int | None)
        if limit is not None:
            arguments["max_episode_steps"] = limit
        arguments.pop("render_mode", None)  # A replay is not drawn.
        return Dataset(
            path=folder,
            name=entry(metadata, "dataset_id", str),
            policy=entry(metadata, "algorithm_name", str),
            description=entry(metadata, "description", str),
            environment=environment,
            arguments=arguments,
            origin={"minari": entry(metadata, "minari_version", str), **origin},
            n_episodes=n_episodes,
        )


def _episode(group: Any, budget: DecodingBudget) -> RecordedEpisode:
    entries: dict[str, Any] = {}
    options: dict[str, Any] = {}
    for name, value in group.attrs.items():
        plain = isinstance(value, np.ndarray | np.generic)
        entries[name] = value.tolist() if plain else value
        # Minari flattens nested mappings to names a/b/c.
        first, *above = name.split("/")
        if first == "options" and above:
            *above, last = above
            inner = options
            for key in above:
                inner = inner.setdefault(key, {})
            inner[last] = entries[name]
    layout = parsed_json(entry(entries, f"{KIND}/state_layout", str))
    digests = parsed_json(entry(entries, f"{KIND}/model_digests", str))
    return RecordedEpisode(
        seed=entry(entries, "seed", int),
        options=options,
        state_layout={name: entry(layout, name, int) for name in layout},
        model_digests={name: entry(digests, name, str) for name in digests},
        observations=_arrays(member(group, "observations"), budget),
        infos=_arrays(member(group, "infos"), budget),
        **{name: _array(member(group, name), budget) for name in PER_STEP},
    )


def _array(dataset: Any, budget: DecodingBudget) -> NDArray[Any]:
    """Return a dataset as an array; text as an array of str."""
    check_readable(dataset, budget)
    if h5py.check_string_dtype(dataset.dtype) is None:
        if dataset.dtype.hasobject:
            raise ValueError(f"{dataset.name} holds neither numbers nor text")
        return np.asarray(dataset[()])
    if not dataset.shape:
        raise ValueError(f"{dataset.name} is one text, not an array")
    texts: list[str] = []
    for start in range(0, len(dataset), _TEXTS):
        # All texts may refer to the same long text.
        texts += dataset.asstr()[start : start + _TEXTS].tolist()
        budget.claim(sum(map(len, texts[start:])), dataset.name)
    budget.claim(4 * len(texts) * max(map(len, texts), default=0), dataset.name)
    return np.array(texts, dtype=str)


def _arrays(group: Any, budget: DecodingBudget) -> dict[str, NDArray[Any]]:
    """Return arrays by name, in nested groups by ``group/name``."""
    check_links(group)
    found: list[tuple[str, Any]] = []
    group.visititems(lambda name, item: found.append((name, item)))
    return {
        name: _array(item, budget)
        for name, item in found
        if isinstance(item, h5py.Dataset)
    }
