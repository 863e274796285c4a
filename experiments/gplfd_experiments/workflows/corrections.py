"""Corrections of a stored skill while it opens doors."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from gplfd_experiments.console.arguments import check_folder, check_least
from gplfd_experiments.console.progress import LOG
from gplfd_experiments.episodes.build import open_watched
from gplfd_experiments.episodes.failures import why_closed
from gplfd_experiments.episodes.practice import corrected
from gplfd_experiments.episodes.task import episode_task, named_doors
from gplfd_experiments.teaching.corrected import CorrectedSkill, CorrectionLesson
from gplfd_experiments.teaching.page import Session, serve
from gplfd_policies.demonstrations.correction import Correction
from gplfd_policies.movements.movement import Movement
from gplfd_policies.movements.skill import Skill
from gplfd_policies.registry.catalogue import method_and_skill

Row = dict[str, str]


def correct_skill(
    file: Path, out: Path, *, doors: Sequence[str], policy: str, seed: int
) -> tuple[Movement, list[Row]]:
    """Open doors with a skill and correct it; return it, and a row of text per door.

    The corrected skill is written to another file, if there was a correction.
    """
    check_least("--seed", seed, 0)
    _check_absent(out)
    method, learned = method_and_skill(policy, file)
    skill: Movement = learned
    rows = []
    for name, config in named_doors(doors).items():
        task = episode_task(name, config, policy=policy, seed=seed)
        LOG.info("%s: watching", name)
        opened = partial(open_watched, task)
        log, correction = corrected(method.follow(skill), seed, name, opened)
        row = {
            "door": name,
            "watched": why_closed(log.failure, log.reason) or "opened alone",
            "then": "-",
        }
        if correction is not None:
            skill = method.update(skill, correction)
            row["watched"] = _led(correction)
            alone = open_watched(task, method.follow(skill))
            row["then"] = why_closed(alone.failure, alone.reason) or "opened alone"
        rows.append(row)
    if skill is not learned and isinstance(skill, Skill):
        skill.save(out)
    return skill, rows


def correct_by_hand(
    file: Path,
    out: Path,
    *,
    doors: Sequence[str],
    policy: str,
    seed: int,
    device: str,
    host: str,
    port: int,
) -> tuple[Movement, list[Row]]:
    """Serve a page on which a person corrects a skill; return as `correct_skill`.

    The corrected skill is saved after every kept correction.
    """
    check_least("--seed", seed, 0)
    _check_absent(out)
    method, learned = method_and_skill(policy, file)
    store = CorrectedSkill(method, learned, out)
    tasks = [
        episode_task(*door, policy=policy, seed=seed)
        for door in named_doors(doors).items()
    ]
    lessons = [
        partial(CorrectionLesson, task, store, device, drawn=True) for task in tasks
    ]
    serve(Session(lessons, store), "correct", device=device, host=host, port=port)
    rows = [
        {"door": correction.door, "watched": _led(correction), "then": "kept"}
        for correction in store.kept
    ]
    return store.skill, rows


def _check_absent(out: Path) -> None:
    check_folder(out.parent)
    if out.exists():
        raise ValueError(
            f"{out} exists, and may hold corrections; give it as the SKILL to correct "
            "it further, or another --out"
        )


def _led(correction: Correction) -> str:
    return f"led for {correction.seconds:.1f} s, phase {correction.phase:.2f}"
