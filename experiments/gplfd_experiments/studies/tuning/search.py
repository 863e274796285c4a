"""Evaluating all candidates, on any engine, resumable; and the file of the best."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from gplfd_experiments.console.arguments import check_folder
from gplfd_experiments.console.progress import LOG, counter
from gplfd_experiments.files.plain_data import entry, read_json, write_json
from gplfd_experiments.files.provenance import code_state, provenance
from gplfd_experiments.files.table import Table, text_table
from gplfd_experiments.studies.engines import Engine, Lost
from gplfd_experiments.studies.tuning.candidates import (
    STANDARD,
    Candidate,
    Protocol,
    candidates,
)
from gplfd_experiments.studies.tuning.objective import (
    Evaluation,
    best,
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
    """Evaluate what has no evaluation, or an error; write down each method's best.

    Args:
        policies: Keys of `gplfd_policies.registry.tuning_spaces.SPACES`.
        folder: Evaluations are kept in ``folder/evaluations/<key>.json``.
        engine: Where to run.
        protocol: On what.

    Returns:
        A table of methods as published and tuned.

    Raises:
        OSError: A file cannot be written.
    """
    check_folder(folder)
    every = {policy: candidates(policy, protocol) for policy in policies}
    _run([one for several in every.values() for one in several], folder, engine)
    found = {
        policy: [_kept(folder, one) for one in several]
        for policy, several in every.items()
    }
    _report(one for several in found.values() for one in several)
    results = {policy: _result(evaluations) for policy, evaluations in found.items()}
    made = provenance({})
    write_json(
        folder / FILE,
        {
            "command": made["command"],
            **_code(),
            "protocol": every[policies[0]][0].definition["protocol"],
            "policies": results,
        },
    )
    return text_table(_table(results))


def _run(every: Sequence[Candidate], folder: Path, engine: Engine) -> None:
    missing = [one for one in every if not _is_finished(_stored(folder, one))]
    done = len(every) - len(missing)
    with (
        contextlib.closing(engine.run(evaluate, missing)) as finished,
        counter("candidate", len(every), done) as bar,
    ):
        for candidate, outcome in finished:
            write_json(_path(folder, candidate), _evaluation(candidate, outcome))
            bar.update()


def _evaluation(candidate: Candidate, outcome: Evaluation | Lost) -> Evaluation:
    if not isinstance(outcome, Lost):
        return outcome
    origin = {"candidate": candidate.definition, **code_state()}
    return {**origin, **failed(outcome.reason), "cpu_s": 0.0}


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


def _kept(folder: Path, candidate: Candidate) -> Evaluation:
    """Return the evaluation of a candidate that has just been run."""
    evaluation = _stored(folder, candidate)
    if evaluation is None:
        raise ValueError(
            f"{_path(folder, candidate)} has gone or changed; run the command again"
        )
    return evaluation


def _is_finished(evaluation: Evaluation | None) -> bool:
    return evaluation is not None and "error" not in evaluation


def _report(evaluations: Iterable[Evaluation]) -> None:
    """Say what the evaluations cost, and which ended in errors."""
    several = list(evaluations)
    seconds = sum(evaluation["cpu_s"] for evaluation in several)
    LOG.info("%d evaluations took %.0f s of a core", len(several), seconds)
    for evaluation in several:
        if "error" in evaluation:
            candidate = evaluation["candidate"]
            LOG.warning(
                "warning: %s, candidate %d: %s",
                candidate["policy"],
                candidate["number"],
                evaluation["error"],
            )


def _result(evaluations: Sequence[Evaluation]) -> dict[str, Any]:
    """Return the best and the published settings of a method, with what they gave."""
    place, ranks = best(evaluations)
    return {
        "evaluations": len(evaluations),
        "errors": sum("error" in one for one in evaluations),
        "published": _described(evaluations[0], ranks[0]),
        "tuned": _described(evaluations[place], ranks[place]),
    }


def _described(evaluation: Evaluation, rank: float) -> dict[str, Any]:
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
            settings = ", ".join(f"{n} {value}" for n, value in one["settings"].items())
            rows.append((f"{policy} {kind}", *_numbers(one), settings))
    heads = ("method", "rank", "NLPD", "closed", "radial force [N]", "settings")
    return Table(columns=heads, rows=tuple(rows), left=True)


def _numbers(one: Mapping[str, Any]) -> tuple[str, str, str, str]:
    rank = f"{one['mean_rank']:.1f}"
    if "error" in one:
        return rank, "-", "-", "-"
    nlpd = "-" if one["nlpd"] is None else f"{one['nlpd']:.2f}"
    closed = f"{one['closed']}/{one['episodes']}"
    return rank, nlpd, closed, f"{one['force_radial_peak_median']:.2f}"
