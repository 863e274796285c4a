"""Writing a data set: the whole folder appears at once, or not at all."""

import hashlib
import io
import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import gymnasium as gym
import h5py
import minari
from minari.serialization import serialize_space

from gplfd_experiments.data.minari.episode import RecordedEpisode, flat, model_hash
from gplfd_experiments.files.folders import check_replaceable, complete_folder
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.files.provenance import provenance
from gplfd_policies.arrays.storage import complete_or_absent

KIND: Final = "gplfd"
"""Name under which this package keeps its own entries, per data set and episode."""

LAYOUT: Final = 2
"""Version of these entries."""

DATA, MAIN_FILE, METADATA_FILE = "data", "main_data.hdf5", "metadata.json"

PER_STEP: Final = ("actions", "rewards", "terminations", "truncations")
"""Arrays that stand alone in an episode; the others are its observations and infos."""

REPRODUCING: Final = ("gplfd", "mujoco", "gymnasium", "numpy", "scipy")
"""Distributions whose versions can change what an environment computes."""

_ID: Final = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]*-v[0-9]+")
_COMPACT: Final = ("v110", "v110")
"""Format of HDF5 1.10 (2016), whose indices are far smaller than the oldest's."""
_LARGEST_CHUNK: Final = 1500  # Rows that are compressed together.


def write_dataset(
    folder: str | Path,
    episodes: Iterable[RecordedEpisode],
    *,
    env: gym.Env[Any, Any],
    policy: str,
    config: Mapping[str, Any],
    overwrite: bool = False,
) -> None:
    """Write a data set that appears at ``folder`` when its last episode is there.

    Until then its compressed episodes are kept in memory, about a kilobyte per step.

    Args:
        folder: Where the data set goes. Its name is the data set's id, so
            ``MINARI_DATASETS_PATH`` set to the folder above it lets
            ``minari.load_dataset`` find it.
        episodes: At least one; taken when the folder is known to be writable.
        env: Environment made by ``gym.make`` in which the episodes ran. Its
            specification is kept, from which Minari's ``recover_environment`` makes it.
        policy: Name of the policy that acted.
        config: Settings of the recording, for the record; JSON-able.
        overwrite: Replace a data set that is there already.

    Raises:
        ValueError: The name is no id, something is there already, the environment's
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
        raise ValueError("the environment must be made by gym.make to be made again")
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
        Its content, and what the metadata say of it.
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
                # Compressed, for states repeat, and so that Minari can append.
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
