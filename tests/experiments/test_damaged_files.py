"""Whatever a file holds, it is read rightly or refused with one clear message.

Files of every kind are damaged, edited and forged by a seeded engine: first the
mutations, then the readers, then the test. `GPLFD_VARIANTS=2000 pytest` with this file
runs a campaign.
"""

import contextlib
import dataclasses
import io
import os
import re
import struct
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import h5py
import numpy as np
import pytest

import gplfd_policies as policies
from gplfd_env import ENVIRONMENT_ID
from gplfd_experiments.data.minari import Recorder, open_dataset, write_dataset
from gplfd_experiments.data.replay import replays
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.episodes.task import EpisodeTask
from gplfd_experiments.files.plain_data import read_json, write_json
from gplfd_experiments.files.provenance import content_hash
from gplfd_experiments.studies.result_format import STAMP
from gplfd_experiments.studies.settings import StudySettings
from gplfd_experiments.studies.settings_file import read_settings, write_settings
from gplfd_experiments.studies.store import result_path, stored_results
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.npz import load_demonstrations, save_demonstrations

pytestmark = pytest.mark.slow

VARIANTS = int(os.environ.get("GPLFD_VARIANTS", "4"))
"""Files per kind of file and of damage."""
MOST_MEMORY = 100 * 2**20
"""Bytes that reading any of these files may take: an archive may unpack to 64 MiB."""
LONGEST_MESSAGE = 1000

Rng = np.random.Generator
Mutation = Callable[[bytes, Rng], bytes]


# ------------------------------------------------------------------ damage to any file
def damaged(content: bytes, rng: Rng) -> bytes:
    """Cut, flip a bit, overwrite, remove, repeat or exchange; most runs are short."""
    start = int(rng.integers(len(content)))
    end = start + int(2 ** rng.uniform(0, np.log2(len(content) - start + 1)))
    head, run, tail = content[:start], content[start:end], content[end:]
    match rng.integers(6):
        case 0:
            return content[: rng.choice([0, 1, 10, start])]
        case 1:
            flipped = content[start] ^ (1 << int(rng.integers(8)))
            return head + bytes([flipped]) + content[start + 1 :]
        case 2:
            filler: bytes = rng.choice([b"\x00", b"\xff", b"9", rng.bytes(1)])
            return head + filler * len(run) + tail
        case 3:
            return head + tail
        case 4:
            return head + run + run + tail
        case _:
            middle = len(run) // 2
            return head + run[middle:] + run[:middle] + tail


# ------------------------------------------------------------------ edited text
TOKENS = (
    *("null", "true", "-1", "0", "0.5", "1e999", "1e308", "NaN", "nan", "-inf", "[]"),
    *("{}", "[1]", "1979-05-27", "'"),
    *('""', '"a"', '"\\ud800"', '"\\u0000"', "é", '{"a": 1, "a": 2}', "{a = 1}"),
    *("7" * 400, "7" * 5000, "0x" + "f" * 4000, "[" * 40 + "]" * 40),
    *("[" * 10**5, '{"a":' * 10**5, '"' + "long" * 10**5 + '"'),
)
VALUE = re.compile(r'-?\d[\d.e+-]*|"[^"]*"|true|false|null|\[[^\[\]]*\]')


def replace_a_value(content: bytes, rng: Rng) -> bytes:
    text = content.decode()
    found = list(VALUE.finditer(text))
    chosen = found[rng.integers(len(found))]
    token = TOKENS[rng.integers(len(TOKENS))]
    return (text[: chosen.start()] + token + text[chosen.end() :]).encode()


def change_lines(content: bytes, rng: Rng) -> bytes:
    lines = content.splitlines(keepends=True)
    one, other = rng.integers(len(lines), size=2)
    lines[one] = [b"", lines[one] * 2, lines[other]][rng.integers(3)]
    return b"".join(lines)


# ------------------------------------------------------------------ forged arrays
ARRAYS: tuple[Any, ...] = (
    *(0, -1.0, 1j, True, "", "a", "\ud7ff", [[1.0]], [np.nan, np.inf, 1.0], ["0", "1"]),
    *(b"bytes", np.zeros(0), np.zeros((0, 6)), np.zeros((3, 6)), np.zeros((5,) * 5)),
    *(np.arange(3, dtype=">i2"), np.zeros(2, "f2"), np.zeros(2, "M8[s]")),
    *(np.zeros(2, [("a", "f8")]), np.array([{}, None]), np.full((3, 6), 1e308)),
)


def archive_of(content: bytes) -> dict[str, Any]:
    with np.load(io.BytesIO(content)) as archive:
        return dict(archive)


def archived(arrays: dict[str, Any]) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def replace_an_array(content: bytes, rng: Rng) -> bytes:
    arrays = archive_of(content)
    arrays[str(rng.choice(list(arrays)))] = ARRAYS[rng.integers(len(ARRAYS))]
    return archived(arrays)


def edit_a_text(content: bytes, rng: Rng) -> bytes:
    """Replace a value in a text, such as the header of a log."""
    arrays = archive_of(content)
    name = rng.choice([n for n, array in arrays.items() if array.dtype.kind == "U"])
    edited = replace_a_value(f'"{arrays[name]}"'.encode(), rng).decode()
    return archived({**arrays, name: edited.removeprefix('"').removesuffix('"')})


def encrypt(content: bytes, rng: Rng) -> bytes:
    """Say of one member that it is encrypted."""
    start = rng.choice([one.start() for one in re.finditer(b"PK\x01\x02", content)])
    return content[: start + 8] + struct.pack("<H", 1) + content[start + 10 :]


# ------------------------------------------------------------------ forged HDF5
def forge_hdf5(content: bytes, rng: Rng) -> bytes:
    """Delete, replace or resize an array or a group, or replace an attribute."""
    stream = io.BytesIO(content)
    with h5py.File(stream, "a") as file:
        items: dict[str, Any] = {}
        file.visititems(lambda name, item: items.update({name: item}))
        name = str(rng.choice(list(items)))
        array = ARRAYS[rng.integers(len(ARRAYS))]
        # What HDF5 refuses to hold leaves the file as it is.
        with contextlib.suppress(TypeError, ValueError):
            if name == "episode_0":
                chosen = str(rng.choice(list(items[name].attrs)))
                items[name].attrs[chosen] = array
            elif rng.random() < 0.3 and isinstance(items[name], h5py.Dataset):
                items[name].resize(int(rng.choice([0, 1, 10**6, 10**14])), axis=0)
            else:
                del file[name]
                file[name if rng.random() < 0.7 else "episode_0/else"] = array
    return stream.getvalue()


# ------------------------------------------------------------------ the readers
@dataclass(frozen=True, kw_only=True)
class Case:
    """A good file, and what reads it."""

    file: Path
    read: Callable[[Path], object]
    mutations: tuple[Mutation, ...]
    reseal: Callable[[], None] = lambda: None
    """What makes another content look like the one that was written."""


DAMAGES: tuple[Mutation, ...] = 6 * (damaged,)
TEXT = (*DAMAGES, replace_a_value, change_lines)
# What else can be wrong with an archive is in tests/policies/test_storage.py.
ARCHIVE = (*DAMAGES, encrypt, replace_an_array, edit_a_text)


def demonstrations(folder: Path, _: EpisodeLog) -> Case:
    file = folder / "demonstrations.npz"
    moving = [Demonstration(times=np.arange(3.0), poses=np.eye(3, 6))] * 2
    save_demonstrations(file, moving, [0.35, None])
    return Case(file=file, read=load_demonstrations, mutations=ARCHIVE)


def episode_log(folder: Path, log: EpisodeLog) -> Case:
    log.save(file := folder / "small.npz")
    return Case(file=file, read=EpisodeLog.load, mutations=ARCHIVE)


def skill(folder: Path, _: EpisodeLog) -> Case:
    file = folder / "skill.npz"
    shown = Teacher().demonstrate_doors([0.35, 0.5], 2, rng=np.random.default_rng(0))
    policies.fit_skill(policies.align(shown, n_samples=10)).save(file)
    return Case(file=file, read=policies.load_skill, mutations=ARCHIVE)


def settings(folder: Path, _: EpisodeLog) -> Case:
    write_settings(file := folder / "study.toml", StudySettings())
    return Case(file=file, read=read_settings, mutations=TEXT)


def plain_json(folder: Path, _: EpisodeLog) -> Case:
    value = {"versions": {"numpy": "2.0"}, "command": ["gplfd"], "cpus": 2, "git": None}
    write_json(file := folder / "study.json", value)
    return Case(file=file, read=read_json, mutations=TEXT)


def result(folder: Path, log: EpisodeLog) -> Case:
    """A damaged result stops no study: its task is run again, the file is named."""
    task = EpisodeTask(policy="gp", door="small", door_config={"radius": 0.35}, seed=0)
    file = result_path(folder, task)
    metrics = episode_metrics(log).as_json()
    write_json(file, {**STAMP, "task": task.definition, "metrics": metrics})

    def read(_: Path) -> None:
        for reason in stored_results(folder, [task]).damaged:
            raise ValueError(reason)

    return Case(file=file, read=read, mutations=TEXT)


def data_set(folder: Path, file: str) -> Case:
    target = folder / "recorded-v0"
    env = gym.make(ENVIRONMENT_ID, max_episode_steps=3)
    recorder = Recorder(env)
    recorder.reset(seed=1, options={"door": {"radius": 0.4}})
    for _ in range(3):
        recorder.step(np.full(6, 0.001))
    write_dataset(target, [recorder.episode], env=env, policy="p", config={})

    def read(_: Path) -> None:
        dataset = open_dataset(target)
        dataset.contents()
        list(replays(dataset, [0]))

    return Case(file=target / "data" / file, read=read, mutations=TEXT)


def metadata(folder: Path, _: EpisodeLog) -> Case:
    return data_set(folder, "metadata.json")


def arrays(folder: Path, _: EpisodeLog) -> Case:
    case = data_set(folder, "main_data.hdf5")
    known = case.file.with_name("metadata.json")

    def reseal() -> None:
        content = read_json(known)
        content["gplfd"]["sha256"] = content_hash(case.file)
        write_json(known, content)

    mutations = (*DAMAGES, forge_hdf5)
    return dataclasses.replace(case, reseal=reseal, mutations=mutations)


CASES = (demonstrations, episode_log, skill, settings, plain_json, result, metadata)


@pytest.fixture(scope="module", params=[*CASES, arrays], ids=lambda make: make.__name__)
def case(request: Any, tmp_path_factory: Any, make_log: Any) -> Case:
    made: Case = request.param(tmp_path_factory.mktemp("case"), make_log(41))
    made.read(made.file)
    return made


def test_a_file_is_read_rightly_or_refused_clearly(case):
    named = case.file.name if "data" not in case.file.parts else "recorded-v0"
    good = case.file.read_bytes()
    read, refused = 0, 0
    for number, mutation in enumerate(VARIANTS * case.mutations):
        what = f"{mutation}, seed {number}"
        case.file.write_bytes(mutation(good, np.random.default_rng(number)))
        if mutation is forge_hdf5:
            case.reseal()
        tracemalloc.start()
        try:
            case.read(case.file)
            read += 1
        except (ValueError, OSError) as error:
            message = str(error)
            refused += 1
            assert named in message, what
            assert len(message) < LONGEST_MESSAGE, what
            assert " ".join(message.split()).isprintable(), what
        finally:
            _, peak = tracemalloc.get_traced_memory()
            tracemalloc.stop()
        assert peak < MOST_MEMORY, what
    case.file.write_bytes(good)
    assert refused > read, "most damage is found"
