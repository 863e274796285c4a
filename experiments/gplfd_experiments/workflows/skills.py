"""Learns, stores and tests skills from files of demonstrations."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from gplfd_experiments.analysis.report.page import write_report
from gplfd_experiments.analysis.report.predictions import overview
from gplfd_experiments.analysis.results.reading import TASKS, read_files, read_results
from gplfd_experiments.console.arguments import check_folder, check_least
from gplfd_experiments.console.progress import LOG
from gplfd_experiments.episodes.task import named_doors
from gplfd_experiments.files.plain_data import entry, read_json
from gplfd_experiments.files.table import text_table
from gplfd_experiments.studies.engines import Engine
from gplfd_experiments.studies.learning_tests.scores import FEWEST
from gplfd_experiments.studies.runner import run_or_resume
from gplfd_experiments.studies.tasks import recorded_tasks
from gplfd_experiments.teaching.taught import read_taught
from gplfd_experiments.workflows.runs import CONFIGURATION
from gplfd_policies.demonstrations.npz import (
    FIRST_POSE,
    FRAME,
    demonstrations_file,
    load_demonstrations,
)
from gplfd_policies.movements.skill import Skill
from gplfd_policies.registry.catalogue import skill_method
from gplfd_policies.registry.method import TrainingInput


def demonstrated_doors(demonstrations: Path) -> tuple[str, ...]:
    """Return the doors of a `gplfd run` or `demos teach`, as given by ``--doors``.

    Empty for demonstrations that are not in the folder of such a command, and if
    ``--doors`` would no longer accept one of the doors.
    """
    file = demonstrations_file(demonstrations)
    record = file.with_name(CONFIGURATION)
    try:
        if record.is_file():
            config = entry(read_json(record), "config", dict[str, Any])
            doors = entry(config, "doors", tuple[str, ...])
            kept = entry(config, "demonstrations_of", dict[str, str])
            names = [(name, doors) for name in kept if kept[name] == file.name]
        else:
            names = [(taught.name, taught.among) for taught in read_taught(file.parent)]
        asked = [
            dict(zip(named_doors(among), among, strict=True))[name]
            for name, among in names
        ]
    except (OSError, ValueError, KeyError):
        return ()
    return tuple(dict.fromkeys(asked))


def learn_skill(demonstrations: Path, file: Path, *, policy: str, seed: int) -> Skill:
    """Learn a skill from a file of demonstrations and store it in another."""
    check_least("--seed", seed, 0)
    method = skill_method(policy)
    check_folder(file.parent)
    if file.is_dir():
        raise ValueError(f"--out {file} is a folder; give a file")
    if file.resolve() == demonstrations_file(demonstrations).resolve():
        raise ValueError(f"--out {file} holds the demonstrations; give another file")
    labelled = load_demonstrations(demonstrations)
    motions = labelled.demonstrations
    LOG.info("learning from %d demonstrations", len(motions))
    target = file.absolute()  # A policy may change the working folder.
    started = time.perf_counter()
    modes = method.learn_modes(TrainingInput(demonstrations=motions, seed=seed))
    if len(modes) > 1:
        kinds = "; ".join(", ".join(map(str, mode.numbers)) for mode in modes)
        raise ValueError(
            f"{demonstrations} holds {len(modes)} kinds of motion, but a skill is one: "
            f"demonstrations {kinds}; put each kind into a set of its own"
        )
    movement = modes[0].movement
    if not isinstance(movement, Skill):
        raise TypeError(f"fit_skill made a {type(movement).__name__}")
    frames = {FRAME: "door", FIRST_POSE: "first pose"}
    movement = replace(movement, frame=frames.get(labelled.frame, "given"))
    movement.save(target)
    LOG.info("learned (%.1f s)", time.perf_counter() - started)
    return movement


def judge(
    recordings: Path,
    folder: Path,
    *,
    policies: Sequence[str],
    reference: str,
    engine: Engine,
    options: Mapping[str, Any],
    columns: int | None = None,
) -> int:
    """Leave each recording out in turn, let every method predict it, write a report.

    It prints the first columns of a table, or all, and returns the number of errors.
    """
    motions = load_demonstrations(recordings).demonstrations
    if len(motions) < FEWEST:
        raise ValueError(
            f"{recordings} holds {len(motions)} demonstration(s); leaving one out and "
            f"learning a spread from the others needs {FEWEST} or more"
        )
    tasks = recorded_tasks(policies, motions)
    names = list(dict.fromkeys(task.policy for task in tasks))
    if reference not in names:
        raise ValueError(
            f"--reference {reference} is not among the tested methods: "
            f"{', '.join(names)}"
        )
    results, _ = read_files((folder / TASKS).glob("[!.]*.json"))
    digest = tasks[0].recordings
    if any(getattr(result.task, "recordings", "") != digest for result in results):
        raise ValueError(
            f"{folder} has results of other recordings, which one report cannot mix; "
            "choose another --out"
        )
    errors = run_or_resume(tasks, options, folder, engine, motions)
    study = read_results(folder)
    write_report(study, folder, reference=reference)
    print(text_table(overview(study.recorded), columns))

    return errors
