"""Writing a data set: the whole folder appears at once, or not at all."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import re
import tempfile
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import gymnasium as gym

from experiments.datasets.minari.episode import Episode, Recorder
from experiments.datasets.minari.packing import pack
from experiments.datasets.minari.physics import arithmetic, model_hash
from experiments.files.provenance import provenance

KIND: Final = "gplfd"
"""Name under which this package keeps its own entries, per data set and episode."""

LAYOUT: Final = 1
"""Version of these entries."""

DATA, MAIN_FILE, METADATA_FILE = "data", "main_data.hdf5", "metadata.json"

REPRODUCING: Final = ("gplfd", "mujoco", "gymnasium", "numpy", "scipy")
"""Distributions whose versions can change what an environment computes."""

_ID: Final = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]*-v[0-9]+")
_NEEDED: Final = ("minari", "h5py", "PIL")


@dataclass(kw_only=True, slots=True)
class DatasetWriter:
    """Takes episode after episode; at most one is kept in memory."""

    folder: Path
    """Minari's root of data sets while writing."""
    name: str
    """Id of the data set."""
    env: gym.Env[Any, Any]
    """Environment that the episodes ran in; kept as its specification."""
    policy: str
    """Name of the policy that acted."""
    config: Mapping[str, Any]
    """Settings of the recording; JSON-able."""
    _dataset: Any = field(init=False, default=None)

    def add(self, episode: Episode) -> None:
        """Write an episode.

        Raises:
            ValueError: An info cannot be stored.
        """
        from minari.data_collector.episode_buffer import EpisodeBuffer

        buffer = EpisodeBuffer(
            seed=episode.seed,
            options=dict(episode.options) or None,
            observations=dict(episode.observations),
            actions=episode.actions,
            rewards=episode.rewards,
            terminations=episode.terminations,
            truncations=episode.truncations,
            infos=_with_plain_text(episode.infos),
        )
        if self._dataset is None:
            self._dataset = self._create(buffer)
        else:
            self._dataset.update_dataset_from_buffer([buffer])
        entries = {
            f"{KIND}/state_layout": json.dumps(dict(episode.state_layout)),
            f"{KIND}/model_digests": json.dumps(dict(episode.model_digests)),
            f"{KIND}/model_hash": model_hash(episode.model_digests),
        }
        storage = self._dataset.storage
        storage.update_episode_metadata([entries], [self._dataset.total_episodes - 1])

    def _create(self, buffer: Any) -> Any:
        import minari

        origin = provenance(self.config)
        versions = {name: origin["versions"][name] for name in REPRODUCING}
        with _minari_root(self.folder), warnings.catch_warnings():
            # Advice to those who publish: name an author and link the code.
            warnings.filterwarnings("ignore", ".* is set to None", UserWarning)
            dataset = minari.create_dataset_from_buffers(
                self.name,
                [buffer],
                env=self.env,
                eval_env=self.env.spec,
                algorithm_name=self.policy,
                description="Door opening, recorded by gplfd; run again with "
                "`gplfd demos replay`.",
                data_format="hdf5",
                requirements=[
                    f"{name}=={version}"
                    for name, version in versions.items()
                    if version != "unknown"
                ],
            )
        entries = {"layout": LAYOUT, "arithmetic": arithmetic(), **origin}
        dataset.storage.update_metadata({KIND: entries})
        return dataset


@contextlib.contextmanager
def new_dataset(
    folder: str | Path,
    *,
    env: gym.Env[Any, Any],
    policy: str,
    config: Mapping[str, Any],
    overwrite: bool = False,
) -> Iterator[DatasetWriter]:
    """Write a data set that appears at ``folder`` when the block succeeds.

    Args:
        folder: Where the data set goes. Its name is the data set's id, so
            ``MINARI_DATASETS_PATH`` set to the folder above it lets
            ``minari.load_dataset`` find it.
        env: Environment made by ``gym.make``, whose specification is kept.
        policy: Name of the policy that acts.
        config: Settings of the recording, for the record; JSON-able.
        overwrite: Replace a data set that is there already.

    Raises:
        ValueError: The name is no id, something is there already, Minari is not
            installed, the environment's arguments cannot be stored, or no episode was
            added.
        OSError: The folder cannot be written.
    """
    target = _checked_target(folder, overwrite=overwrite)
    # The environment to make again is the one inside.
    inside = env.env if isinstance(env, Recorder) else env
    _check_specification(inside)
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(
        prefix=f".{target.name}.", dir=target.parent
    ) as temporary:
        root = Path(temporary)
        writer = DatasetWriter(
            folder=root, name=target.name, env=inside, policy=policy, config=config
        )
        yield writer
        written = root / target.name
        if not written.exists():
            raise ValueError("a data set needs at least one episode; none was added")
        pack(written / DATA / MAIN_FILE)
        if target.exists():
            target.rename(root / "replaced")
        try:
            written.rename(target)
        except OSError:
            if (root / "replaced").exists():
                (root / "replaced").rename(target)
            raise


def _checked_target(folder: str | Path, *, overwrite: bool) -> Path:
    """Return the folder's path; nothing is written.

    Raises:
        ValueError: See `new_dataset`.
    """
    target = Path(folder).absolute()
    if not _ID.fullmatch(target.name):
        raise ValueError(
            f"{folder}: a data set's folder is named after its Minari id, letters, "
            "digits, _ and - with a version at the end, for example door-opening-v0"
        )
    missing = [name for name in _NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        raise ValueError(
            f"{' and '.join(missing)} not installed; data sets need "
            "pip install 'gplfd[minari]'"
        )
    if not target.exists():
        return target
    if not (target / DATA / METADATA_FILE).is_file():
        raise ValueError(f"{folder} exists and is not a data set; give another folder")
    if not overwrite:
        raise ValueError(
            f"{folder} exists; give another folder, or --overwrite to replace it"
        )
    return target


def _check_specification(env: gym.Env[Any, Any]) -> None:
    spec = env.spec
    if spec is None:
        raise ValueError("the environment must be made by gym.make to be made again")
    try:
        spec.to_json()
    except TypeError as error:
        raise ValueError(
            f"the arguments {spec.kwargs} of {spec.id} cannot be stored ({error}); "
            "give names, numbers or mappings instead of objects"
        ) from error


@contextlib.contextmanager
def _minari_root(folder: Path) -> Iterator[None]:
    """Let Minari make its data sets under ``folder``; only its environment tells it."""
    name = "MINARI_DATASETS_PATH"
    before = os.environ.get(name)
    os.environ[name] = str(folder)
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before


def _with_plain_text(infos: Mapping[str, Any]) -> dict[str, Any]:
    """Text as lists of str, which is how Minari stores it."""
    plain: dict[str, Any] = {}
    for name, value in infos.items():
        if isinstance(value, Mapping):
            plain[name] = _with_plain_text(value)
        else:
            plain[name] = value.tolist() if value.dtype.kind == "U" else value
    return plain
