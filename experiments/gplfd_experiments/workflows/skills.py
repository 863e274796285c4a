"""Skills from files of demonstrations: learned once, kept, and judged."""

import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

from gplfd_experiments.analysis.report.page import write_report
from gplfd_experiments.analysis.report.predictions import overview
from gplfd_experiments.analysis.results.reading import TASKS, read_files, read_results
from gplfd_experiments.console.arguments import check_folder, check_least
from gplfd_experiments.console.progress import LOG
from gplfd_experiments.data.npz import load_demonstrations
from gplfd_experiments.recording.learned import record_learned
from gplfd_experiments.studies.engines import Engine
from gplfd_experiments.studies.learning_tests.methods import learn
from gplfd_experiments.studies.learning_tests.recorded import FEWEST
from gplfd_experiments.studies.plan import recorded_tasks
from gplfd_experiments.studies.session import carry_out
from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.movements.skill import Skill, fit_skill
from gplfd_policies.registry.catalogue import POLICIES, policy_named
from gplfd_policies.registry.method import Method, TrainingInput

RECORDING: Final = "skill.rrd"
"""What was learned, in a folder of `judge`."""


def skill_method(policy: str) -> Method:
    """Return the method of a policy that learns and follows skills.

    Raises:
        ValueError: There is no such policy, or it learns something else.
    """
    method = policy_named(policy).method
    if method is not None and _fits_skills(method):
        return method
    able = [
        name
        for name, one in POLICIES.items()
        if one.method is not None and _fits_skills(one.method)
    ]
    raise ValueError(
        f"policy {policy!r} learns no skill that a file could hold; choose one of "
        f"{', '.join(sorted(able))}"
    )


def _fits_skills(method: Method) -> bool:
    fit = method.fit
    return (fit.func if isinstance(fit, partial) else fit) is fit_skill


def learn_skill(demonstrations: Path, file: Path, *, policy: str, seed: int) -> Skill:
    """Learn a skill from a file of demonstrations and keep it in another.

    Args:
        demonstrations: File of `gplfd_experiments.data.npz`.
        file: Where to write the skill; an existing file is replaced.
        policy: Name of a policy that learns skills.
        seed: Seeds whatever is random in the learning.

    Raises:
        ValueError: An argument or the file of demonstrations is wrong.
        OSError: A file cannot be read or written.
    """
    check_least("--seed", seed, 0)
    method = skill_method(policy)
    check_folder(file.parent)
    given = load_demonstrations(demonstrations).demonstrations
    LOG.info("learning from %d demonstrations", len(given))
    started = time.perf_counter()
    with one_thread:
        movement = method.learn(TrainingInput(demonstrations=given, seed=seed))
    if not isinstance(movement, Skill):
        raise TypeError(f"fit_skill made a {type(movement).__name__}")
    movement.save(file)
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
) -> int:
    """Leave each recording out in turn, let every method predict it, and report.

    Args:
        recordings: File of `gplfd_experiments.data.npz`.
        folder: Where results, report and recording are written; may have results.
        policies: Names of methods; see `gplfd_experiments.studies.plan`.
        reference: With which the others are compared, one of them.
        engine: Where to run.
        options: The command's, for the record; JSON-able.

    Returns:
        The number of tests that ended in an error.

    Raises:
        ValueError: An argument or the file is wrong.
        OSError: A file cannot be read or written.
    """
    given = load_demonstrations(recordings).demonstrations
    if len(given) < FEWEST:
        raise ValueError(
            f"{recordings} holds {len(given)} demonstration(s); leaving one out and "
            f"learning a spread from the others needs {FEWEST} or more"
        )
    tasks = recorded_tasks(policies, given)
    names = list(dict.fromkeys(task.policy for task in tasks))
    if reference not in names:
        raise ValueError(
            f"--reference {reference} is not among the judged: {', '.join(names)}"
        )
    found, _ = read_files((folder / TASKS).glob("[!.]*.json"))
    own = tasks[0].recordings
    if any(getattr(one.task, "recordings", "") != own for one in found):
        raise ValueError(
            f"{folder} has results of something else than these recordings, which one "
            "page would mix; choose another --out"
        )
    errors = carry_out(tasks, options, folder, engine, given)
    results = read_results(folder)
    write_report(results, folder, reference=reference)
    print(overview(results.recorded))

    # What the reference learns from all recordings, as a recording.
    file = folder / RECORDING
    file.unlink(missing_ok=True)  # Of an earlier run, which shows something else.
    method = policy_named(reference).method
    if method is None:
        return errors
    try:
        with one_thread:
            movement, _ = learn(method, given, 0)
            record_learned(file, movement, reference)
    # Methods answer what they cannot learn from with errors of every kind.
    except Exception as error:
        LOG.error(
            "%s was not written: %s cannot learn from these recordings: %s: %s. Look "
            "at them as they were recorded: before_after.png and report.txt of `gplfd "
            "demos import` say what is unusual",
            file,
            reference,
            type(error).__name__,
            error,
        )
    return errors
