"""Submissions: results of trials in an archive, and their verification by running.

An archive has the result files, study.json, a card of what took part, the files of
users' policies, and submission.json with the SHA-256 of each. It holds no pickles.
"""

import contextlib
import hashlib
import json
import math
import os
import random
import re
import tempfile
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from gplfd_experiments.analysis.results.reading import StudyResults, read_results
from gplfd_experiments.analysis.results.trials import protocol_problems
from gplfd_experiments.console.progress import LOG
from gplfd_experiments.files import plain_data
from gplfd_experiments.files.provenance import code_state
from gplfd_experiments.studies.engines import Engine
from gplfd_experiments.studies.runner import run_study
from gplfd_experiments.studies.sources import chosen
from gplfd_experiments.studies.trials.protocol import VERSION
from gplfd_experiments.workflows.settings import Card
from gplfd_policies.arrays.storage import complete_or_absent
from gplfd_policies.registry.built_in import POLICIES
from gplfd_policies.registry.catalogue import module_files, split_name

TOLERANCE: Final = 0.1
"""Largest difference of numbers of results from another processor: 0.1 in their unit
(N, degrees, s, mm), or a tenth of a percent."""

_STAMP: Final = ("gplfd submission", 1)
_MEMBERS: Final = re.compile(
    r"(submission|study)\.json|card\.toml|tasks/[\w-]+\.json|"
    r"policies(/(?!\.\.?/)[\w. -]*[\w-])+"
)
_LARGEST: Final = 2**30  # Size of all members together [bytes].


def submit(folder: Path, out: Path, card: Card, files: Sequence[Path]) -> list[str]:
    """Write the archive of trials, with further files of users' policies.

    Returns what does not follow the protocol; then nothing is written.
    """
    if absent := [name for name, value in asdict(card).items() if not value]:
        names = ", ".join(absent)
        raise ValueError(f"a submission must state {names}, by options or a --card")
    results, here = read_results(folder), Path.cwd()
    if problems := protocol_problems(results):
        return problems
    members = {"study.json": (folder / "study.json").read_bytes()}
    for name in sorted(f"tasks/{result.task.key}.json" for result in results.all):
        result = plain_data.read_json(folder / name)
        result.pop("traceback", None)  # It names folders of the machine.
        members[name] = plain_data.json_text(result).encode()
    attached = {os.path.relpath(file): file.read_bytes() for file in files}
    for task in {e.task.policy: e.task for e in results.episodes}.values():
        if (task.policy_source or {}).get("kind") == "module":
            if chosen(task.policy).source != task.policy_source:
                raise ValueError(f"policy {task.policy!r} has changed since its trials")
            attached |= module_files(task.policy, here)
    members |= {f"policies/{Path(x).as_posix()}": attached[x] for x in sorted(attached)}
    lines = [f"{name} = {json.dumps(value)}\n" for name, value in asdict(card).items()]
    members["card.toml"] = "".join(lines).encode()
    about = {"protocol": VERSION, "files": _hashes(members), **code_state()}
    text = plain_data.json_text({**plain_data.stamp(*_STAMP), **about})
    for name in (members := {"submission.json": text.encode(), **members}):
        if not _MEMBERS.fullmatch(name):
            raise ValueError(
                f"{name}: a submission has files of the working folder only; start the "
                "trials in the folder of the policy, and name it as module:function"
            )
    with complete_or_absent(out) as temporary, zipfile.ZipFile(temporary, "w") as file:
        for name, content in members.items():
            # Without a date: the same results give the same bytes.
            file.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)
    return []


def verify(path: Path, seed: int, engine: Engine, *, trust: bool) -> list[str]:
    """Check an archive, and run a tenth of its tasks again; return what differs.

    ValueError: it is no submission, or foreign policies in it are not trusted.
    """
    with plain_data.naming(path), tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        if changed := extracted(path, folder):
            return changed
        plain_data.read_toml(folder / "card.toml")
        results = read_results(folder)
        # By their names: what an archive says of their sources may be wrong.
        names = {episode.policy for episode in results.episodes}
        foreign = sorted(name for name in names if split_name(name)[0] not in POLICIES)
        if foreign and not trust:
            raise ValueError(
                f"it runs foreign policies: {', '.join(foreign)}. Read what is in its "
                "folder policies, and add --trust to run them"
            )
        (folder / "policies").mkdir(exist_ok=True)
        with contextlib.chdir(folder / "policies"):
            problems = protocol_problems(results)
            return problems or _differences(results, folder / "again", seed, engine)


def extracted(path: Path, folder: Path) -> list[str]:
    """Write the members of an archive; return which of them have another hash.

    ValueError: it is no submission, or of another protocol.
    """
    try:
        with zipfile.ZipFile(path) as file:
            sizes = {info.filename: info.file_size for info in file.infolist()}
            if strange := [name for name in sizes if not _MEMBERS.fullmatch(name)]:
                raise KeyError(f"it has {strange[0]!r:.80}")
            if len(sizes) != len(file.infolist()) or sum(sizes.values()) > _LARGEST:
                raise KeyError("it has a file twice, or more than a gigabyte")
            members = {name: file.read(name) for name in sizes}
        about = plain_data.parsed_json(members.pop("submission.json").decode())
        plain_data.check_stamp(about, *_STAMP)
        stated = plain_data.entry(about, "files", dict[str, str])
        protocol = plain_data.entry(about, "protocol", str)
    # Those of missing members, of encrypted ones, and of damage.
    except (KeyError, RuntimeError, zipfile.BadZipFile, zlib.error, EOFError) as error:
        raise ValueError(f"it is no submission: {error}") from error
    if protocol != VERSION:
        raise ValueError(f"it is of protocol {protocol}, not of {VERSION}")
    for name, content in members.items():
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)
    changed = sorted({name for name, _ in _hashes(members).items() ^ stated.items()})
    return [f"{name}: changed, not of the stated hash" for name in changed]


def _hashes(members: Mapping[str, bytes]) -> dict[str, str]:
    return {name: hashlib.sha256(members[name]).hexdigest() for name in members}


def _differences(
    results: StudyResults, again: Path, seed: int, engine: Engine
) -> list[str]:
    """Run a random tenth of the episodes again; return how they differ."""
    before = {episode.task.key: episode for episode in results.episodes}
    drawn = random.Random(seed).sample(sorted(before), math.ceil(len(before) / 10))
    LOG.info("running %d of %d tasks again, --seed %d", len(drawn), len(before), seed)
    for _ in run_study(again, [before[key].task for key in drawn], engine):
        pass
    differences, codes = [], set()
    for after in read_results(again).episodes:
        task, stored = after.task, before[after.task.key]
        codes |= {stored.code, after.code}
        exact = stored.machine == after.machine
        pairs: dict[str, Any] = {"error": (bool(stored.error), bool(after.error))}
        for name in stored.metrics.keys() | after.metrics.keys():
            if not name.startswith(("latency_", "cpu_")):
                pairs[name] = stored.metrics.get(name), after.metrics.get(name)
        where = f"{task.policy}, {task.trial}, {task.level}, {task.door}, {task.seed}"
        differences += [
            f"{where}: {name} is {old}, and {new} when it is run again {after.error}"
            for name, (old, new) in sorted(pairs.items())
            if not (old == new if exact else _close(old, new))
        ]
    if len(codes) > 1:
        LOG.warning("warning: of different code: %s", "; ".join(sorted(codes)))
    return differences


def _close(old: Any, new: Any) -> bool:
    """Return whether values are equal to the tolerance, or lists, as of forecasts."""
    if isinstance(old, float) and isinstance(new, float):
        return math.isclose(old, new, rel_tol=1e-3, abs_tol=TOLERANCE)
    return old == new or isinstance(old, list | tuple)
