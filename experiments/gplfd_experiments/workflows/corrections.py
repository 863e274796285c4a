"""Corrections of a stored skill while it opens doors."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from gplfd_experiments.console.arguments import check_folder, check_least
from gplfd_experiments.console.progress import LOG
from gplfd_experiments.episodes.build import open_watched
from gplfd_experiments.episodes.failures import why_closed
from gplfd_experiments.episodes.practice import corrected
from gplfd_experiments.episodes.task import EpisodeTask, episode_task, named_doors
from gplfd_experiments.teaching.lesson import CorrectionLesson
from gplfd_experiments.teaching.page import Session, serve
from gplfd_experiments.teaching.taught import CorrectedSkill
from gplfd_experiments.workflows.runs import check_frame
from gplfd_policies.demonstrations.demonstration import Correction
from gplfd_policies.movements.movement import Movement
from gplfd_policies.registry.catalogue import method_and_skill

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
    a person in a browser. The corrected skill is written to another file after every
    correction that is kept.
    """
    check_least("--seed", seed, 0)
    check_folder(out.parent)
    if out.exists():
        raise ValueError(
            f"{out} exists, and may hold corrections; give it as the SKILL to correct "
            "it further, or another --out"
        )
    method, skill = method_and_skill(policy, file)
    check_frame(skill.frame, file)
    store = CorrectedSkill(method, skill, out)
    tasks = [
        episode_task(*door, policy=policy, seed=seed)
        for door in named_doors(doors).items()
    ]
    if page is None:
        return store.skill, [_corrected(task, store) for task in tasks]
    lessons = [
        partial(CorrectionLesson, task, store, page["device"], drawn=True)
        for task in tasks
    ]
    serve(Session(lessons, store), "correct", **page)
    rows = [
        {"door": correction.door, "watched": _led(correction), "then": "kept"}
        for correction in store.kept
    ]
    return store.skill, rows


def _corrected(task: EpisodeTask, store: CorrectedSkill) -> Row:
    """Let the synthetic corrector watch an episode; return what happened."""
    LOG.info("%s: watching", task.door)
    agent, opened = store.method.follow(store.skill), partial(open_watched, task)
    log, correction = corrected(agent, task.seed, task.door, opened)
    then = "-"
    watched = why_closed(log.failure, log.reason) or "opened alone"
    if correction is not None:
        store.keep(correction)
        alone = opened(store.method.follow(store.skill))
        watched = _led(correction)
        then = why_closed(alone.failure, alone.reason) or "opened alone"
    return {"door": task.door, "watched": watched, "then": then}


def _led(correction: Correction) -> str:
    return f"led for {correction.seconds:.1f} s, phase {correction.phase:.2f}"
