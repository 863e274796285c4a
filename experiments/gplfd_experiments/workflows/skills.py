"""Learns, stores, tests and corrects skills."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from gplfd_experiments.analysis.report.page import write_report
from gplfd_experiments.analysis.report.sections import overview
from gplfd_experiments.analysis.results.reading import TASKS, read_files, read_results
from gplfd_experiments.console import arguments, progress
from gplfd_experiments.episodes import build, leading
from gplfd_experiments.episodes.metrics import why_closed
from gplfd_experiments.episodes.task import episode_task, named_doors
from gplfd_experiments.files import plain_data, table
from gplfd_experiments.studies import engines, runner
from gplfd_experiments.studies.learning_tests.scores import FEWEST
from gplfd_experiments.studies.tasks import recorded_tasks
from gplfd_experiments.teaching import lesson
from gplfd_experiments.teaching.page import TeachingSession, serve
from gplfd_experiments.workflows.runs import CONFIGURATION
from gplfd_policies.demonstrations import npz
from gplfd_policies.demonstrations.demonstration import Correction
from gplfd_policies.movements.movement import Movement
from gplfd_policies.movements.skill import Skill, load_skill
from gplfd_policies.registry.catalogue import method_and_skill, skill_method
from gplfd_policies.registry.method import TrainingInput


def demonstrated_doors(demonstrations: Path) -> tuple[str, ...]:
    """Return the ``--doors`` of the run or lesson of demonstrations; else nothing."""
    file = npz.demonstrations_file(demonstrations)
    try:
        config = plain_data.read_json(file.with_name(CONFIGURATION))["config"]
        doors = zip(config["doors"], config["demonstrations_of"].values(), strict=True)
        return tuple(door for door, kept in doors if kept == file.name)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        recordings = lesson.read_taught(file.parent)
        return tuple(dict.fromkeys(recording.name for recording in recordings))


def learn_skill(demonstrations: Path, file: Path, *, policy: str, seed: int) -> Skill:
    """Learn a skill from a file of demonstrations and store it in another."""
    arguments.check_least("--seed", seed, 0)
    method = skill_method(policy)
    arguments.check_folder(file.parent)
    if file.resolve() == npz.demonstrations_file(demonstrations).resolve():
        raise ValueError(f"--out {file} holds the demonstrations; give another file")
    if file.exists() and load_skill(file).corrections:
        raise ValueError(f"--out {file} has corrections; give another file")
    labelled = npz.load_demonstrations(demonstrations)
    motions = labelled.demonstrations
    progress.LOG.info("learning from %d demonstrations", len(motions))
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
    assert isinstance(movement, Skill), "skill_method accepts no other learner"
    frames = {npz.FRAME: "door", npz.FIRST_POSE: "first pose"}
    movement = replace(movement, frame=frames.get(labelled.frame, "given"))
    movement.save(target)
    progress.LOG.info("learned (%.1f s)", time.perf_counter() - started)
    return movement


def judge(
    recordings: Path,
    folder: Path,
    *,
    policies: Sequence[str],
    reference: str,
    engine: engines.Engine,
    options: Mapping[str, Any],
    columns: int | None = None,
) -> int:
    """Predict each recording from the others; print, report, return how many errors."""
    motions = npz.load_demonstrations(recordings).demonstrations
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
    errors = runner.run_or_resume(tasks, options, folder, engine, motions)
    study = read_results(folder)
    write_report(study, folder, reference=reference)
    print(table.text_table(overview(study.recorded), columns))
    return errors


Row = dict[str, str]


def correct_skill(
    file: Path,
    out: Path,
    *,
    doors: Sequence[str],
    policy: str,
    seed: int,
    page: Mapping[str, Any] | None = None,
) -> tuple[Movement, list[Row]]:
    """Open doors with a skill and correct it; return it, and a row of text per door.

    A synthetic corrector leads the hand, or, with the device, host and port of a page,
    a person in a browser. The skill is written after every kept correction.
    """
    arguments.check_least("--seed", seed, 0)
    arguments.check_folder(out.parent)
    if out.exists():
        raise ValueError(
            f"{out} exists, and may hold corrections; give it as the SKILL to correct "
            "it further, or another --out"
        )
    method, skill = method_and_skill(policy, file)
    npz.check_frame(skill.frame, file)
    store = lesson.CorrectedSkill(method, skill, out)
    named = named_doors(doors).items()
    tasks = [episode_task(*door, policy=policy, seed=seed) for door in named]
    if page is not None:
        lesson_of = partial(lesson.CorrectionLesson, drawn=True)
        lessons = [partial(lesson_of, task, store, page["device"]) for task in tasks]
        serve(TeachingSession(lessons, store), "correct", **page)
        return store.skill, [_row(correction, "kept") for correction in store.kept]
    rows: list[Row] = []
    for task in tasks:
        progress.LOG.info("%s: watching", task.door)
        agent, opened = method.follow(store.skill), partial(build.open_watched, task)
        log, correction = leading.corrected(agent, task.seed, task.door, opened)
        if correction is None:
            watched = why_closed(log.failure, log.reason) or "opened alone"
            rows.append({"door": task.door, "watched": watched, "then": "-"})
        else:
            store.keep(correction)
            alone = opened(method.follow(store.skill))
            then = why_closed(alone.failure, alone.reason) or "opened alone"
            rows.append(_row(correction, then))
    return store.skill, rows


def _row(correction: Correction, then: str) -> Row:
    watched = f"led for {correction.seconds:.1f} s, phase {correction.phase:.2f}"
    return {"door": correction.door, "watched": watched, "then": then}
