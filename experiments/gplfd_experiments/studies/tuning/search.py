"""Search for the best settings on any engine, resumable; and the file of the best."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from gplfd_experiments.console.arguments import check_folder
from gplfd_experiments.console.progress import LOG, counter
from gplfd_experiments.files.plain_data import entry, read_json, write_json
from gplfd_experiments.files.provenance import code_state, provenance
from gplfd_experiments.files.table import Table, text_table
from gplfd_experiments.studies.engines import Engine, Lost
from gplfd_experiments.studies.tuning.objective import (
    STANDARD,
    Candidate,
    Evaluation,
    Protocol,
    best,
    candidates,
    evaluate,
    failed,
    task_numbers,
)

FILE: Final = "tuned.json"
"""Name of the file of the best settings, in the folder of a tuning."""


def tune(
    policies: Sequence[str],
    folder: Path,
    engine: Engine,
    protocol: Protocol = STANDARD,
) -> str:
    """Evaluate what is missing or had an error; write the best, and return a table."""
    check_folder(folder)
    every = {policy: candidates(policy, protocol) for policy in policies}
    several = [one for own in every.values() for one in own]
    missing = [
        one for one in several if "error" in (_stored(folder, one) or {"error": ""})
    ]
    with (
        contextlib.closing(engine.run(evaluate, missing)) as finished,
        counter("candidate", len(several), len(several) - len(missing)) as bar,
    ):
        for candidate, outcome in finished:
            evaluation = outcome
            if isinstance(outcome, Lost):
                origin = {"candidate": candidate.definition, **code_state()}
                evaluation = {**origin, **failed(outcome.reason), "cpu_s": 0.0}
            write_json(_path(folder, candidate), evaluation)
            bar.update()

    results: dict[str, Any] = {}
    seconds = 0.0
    for policy, own in every.items():
        evaluations = []
        for one in own:
            if (kept := _stored(folder, one)) is None:
                path = _path(folder, one)
                raise ValueError(f"{path} has gone or changed; run the command again")
            evaluations.append(kept)
        seconds += sum(one["cpu_s"] for one in evaluations)
        place, ranks = best(evaluations)
        results[policy] = {
            "evaluations": len(evaluations),
            "errors": sum("error" in one for one in evaluations),
            "published": _summary(evaluations[0], ranks[0]),
            "tuned": _summary(evaluations[place], ranks[place]),
        }
        for number, evaluation in enumerate(evaluations):
            if "error" in evaluation:
                message = "warning: %s, candidate %d: %s"
                LOG.warning(message, policy, number, evaluation["error"])
    LOG.info("%d evaluations took %.0f s of a core", len(several), seconds)
    write_json(
        folder / FILE,
        {
            "command": provenance({})["command"],
            **_code(),
            "protocol": several[0].definition["protocol"],
            "policies": results,
        },
    )
    return text_table(_table(results))


def _code() -> dict[str, Any]:
    return {name: code_state()[name] for name in ("versions", "git")}


def _path(folder: Path, candidate: Candidate) -> Path:
    return folder / "evaluations" / f"{candidate.key}.json"


def _stored(folder: Path, candidate: Candidate) -> Evaluation | None:
    """Return the evaluation of a candidate by the present code.

    None if there is none, a damaged one, or one by other code: methods are compared
    by one version.
    """
    try:
        evaluation = read_json(_path(folder, candidate))
        if entry(evaluation, "candidate", dict[str, Any]) != candidate.definition:
            return None
        if any(evaluation.get(name) != state for name, state in _code().items()):
            return None
        entry(evaluation, "cpu_s", float)
        if "error" not in evaluation:
            entry(evaluation, "nlpd", float | None)
            entry(evaluation, "episodes", tuple[dict[str, Any], ...])
    except (OSError, ValueError):
        return None
    return evaluation


def _summary(evaluation: Evaluation, rank: float) -> dict[str, Any]:
    """Return the settings of a candidate, its rank and its numbers."""
    numbers: dict[str, Any] = {"mean_rank": rank}
    if "error" in evaluation:
        numbers["error"] = evaluation["error"]
    else:
        closed, force = task_numbers(evaluation)
        numbers |= {
            "nlpd": evaluation["nlpd"],
            "episodes": len(evaluation["episodes"]),
            "closed": closed,
            "force_radial_peak_median": force,
        }
    return {"settings": evaluation["candidate"]["settings"], **numbers}


def _table(results: Mapping[str, Mapping[str, Any]]) -> Table:
    """Return methods as published and tuned, side by side."""
    rows = []
    for policy, result in results.items():
        for kind in ("published", "tuned"):
            one = result[kind]
            numbers = ["-", "-", "-"]
            if "error" not in one:
                nlpd = "-" if one["nlpd"] is None else f"{one['nlpd']:.2f}"
                closed = f"{one['closed']}/{one['episodes']}"
                numbers = [nlpd, closed, f"{one['force_radial_peak_median']:.2f}"]
            settings = ", ".join(f"{n} {value}" for n, value in one["settings"].items())
            rank = f"{one['mean_rank']:.1f}"
            rows.append((f"{policy} {kind}", rank, *numbers, settings))
    heads = ("method", "rank", "NLPD", "closed", "radial force [N]", "settings")
    return Table(columns=heads, rows=tuple(rows), left=True)
