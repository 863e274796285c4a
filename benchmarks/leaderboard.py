"""Tables of the trials: python benchmarks/leaderboard.py [--write].

They are computed from trials.json, which `gplfd report` writes for `gplfd trials`,
and from the archives of `gplfd submit` in docs/results/submissions. A value of a seed
is the mean over doors, levels and trials. A share is the mean of the seeds with
Student's interval; other measures are the Hodges-Lehmann estimate with its interval
(95 % each).
"""

import re
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import fmean
from typing import Any, Final

import tyro

from gplfd_experiments.analysis.results.reading import read_results
from gplfd_experiments.analysis.results.statistics import (
    Shift,
    holm,
    mean_shift,
    shift,
    signed_rank,
)
from gplfd_experiments.analysis.results.trials import (
    MEASURES,
    SMALLEST_SHARE,
    success_measure,
    trial_answers,
)
from gplfd_experiments.files.plain_data import naming, read_json, read_toml
from gplfd_experiments.files.table import Table, markdown_table
from gplfd_experiments.studies.trials.protocol import REFERENCES, TRACKS, TRIALS
from gplfd_experiments.studies.trials.protocol import VERSION as PROTOCOL
from gplfd_experiments.workflows.submissions import extracted
from gplfd_policies.registry.built_in import POLICIES
from gplfd_policies.registry.catalogue import split_name

ROOT: Final = Path(__file__).parents[1]
STORED: Final = ROOT / "docs/results/trials.json"
SUBMISSIONS: Final = ROOT / "docs/results/submissions"
ACROSS: Final = ("force_radial_impulse", "force_radial_20ms")
NOT_RUN: Final = "*not run yet*"

Answers = Mapping[str, Mapping[str, Mapping[str, Any]]]
"""Measures by trial, level and policy."""


def published() -> list[Path]:
    """Return the stored results of the project, and the archives of other people."""
    return [*filter(Path.exists, [STORED]), *sorted(SUBMISSIONS.glob("*.zip"))]


def submitted(archive: Path) -> dict[str, Any]:
    """Return what trials.json would hold of the foreign policies of an archive.

    They are named after policy and archive, and have an entry ``knows``.
    """
    with naming(archive), tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        if changed := extracted(archive, folder):
            raise ValueError(changed[0])
        knows = ", ".join(read_toml(folder / "card.toml")["knowledge"])
        content = trial_answers(read_results(folder))
    for levels in content["trials"].values():
        for level, policies in levels.items():
            levels[level] = {
                f"{policy} ({archive.stem})": {**numbers, "knows": knows}
                for policy, numbers in policies.items()
                if split_name(policy)[0] not in POLICIES
            }
    return content


def answers_of(files: Iterable[Path]) -> Answers:
    """Return what files hold together; of a policy in several what the first says.

    Raises ValueError for a file of another protocol, or a changed archive.
    """
    answers: dict[str, dict[str, dict[str, Any]]] = {}
    for file in files:
        content = submitted(file) if file.suffix == ".zip" else read_json(file)
        if content.get("protocol") != PROTOCOL:
            raise ValueError(
                f"{file} is of protocol {content.get('protocol')}, and the leaderboard "
                f"of {PROTOCOL}: run the trials again"
            )
        for trial, levels in content["trials"].items():
            for level, policies in levels.items():
                together = answers.setdefault(trial, {})
                together[level] = policies | together.get(level, {})
    return answers


def levels_of(trial: str) -> list[str]:
    """Return the levels of a trial but those with a prior mean, which not all take."""
    levels = TRIALS[trial].levels.items()
    return [name for name, level in levels if level.prior_radius is None]


def ran(answers: Answers, trial: str) -> set[str]:
    """Return the policies that ran at all levels of a trial and lost no episode."""
    levels = [answers.get(trial, {}).get(level, {}) for level in levels_of(trial)]
    return set.intersection(*({p for p in at if not at[p]["lost"]} for at in levels))


def ranked(answers: Answers, trials: Sequence[str]) -> list[str]:
    """Return the policies that `ran` in all trials, the most successful first."""
    policies = sorted(set.intersection(*(ran(answers, trial) for trial in trials)))
    return sorted(policies, key=lambda p: -fmean(by_seed(answers, trials, p)))


def by_seed(
    answers: Answers, trials: Sequence[str], policy: str, measure: str = "success"
) -> list[float]:
    """Return the mean of a measure over the trials that have it, by seed.

    Trials have equal weights, and so have the levels of a trial.
    """
    means = []
    for trial in trials:
        own = success_measure(TRIALS[trial]) if measure == "success" else measure
        if own in TRIALS[trial].measures:
            levels = [answers[trial][level][policy] for level in levels_of(trial)]
            seeds = [level[own]["seeds"] for level in levels]
            common = set.intersection(*map(set, seeds))
            means.append({seed: fmean(s[seed] for s in seeds) for seed in common})
    common = set.intersection(*map(set, means)) if means else set()
    return [fmean(mean[seed] for mean in means) for seed in sorted(common)]


def typical(values: Sequence[float], measure: str, than: Sequence[float] = ()) -> Shift:
    """Return the typical value of a seed, or its difference; shares in percent."""
    others = than or [0.0] * len(values)
    if not MEASURES[measure].share:
        return shift(values, others)
    value = mean_shift(*([100.0 * x for x in shares] for shares in (values, others)))
    if than:
        return value
    return replace(value, low=max(value.low, 0.0), high=min(value.high, 100.0))


def cell(
    answers: Answers,
    trials: Sequence[str],
    policy: str,
    measure: str = "success",
    than: str = "",
) -> str:
    """Return `typical` of a policy, or its difference, above the interval.

    A dash, if a policy did not take part in all trials, or none has the measure.
    """
    if not all({policy, than or policy} <= ran(answers, trial) for trial in trials):
        return "–"
    values = by_seed(answers, trials, policy, measure)
    others = by_seed(answers, trials, than, measure) if than else []
    if not values:
        return "–"
    value, shown = typical(values, measure, others), MEASURES[measure]
    if shown.share:
        shown = replace(shown, unit="" if than else "%", digits=0)
    sign = "+" * (bool(than) and round(value.estimate, shown.digits) > 0.0)
    estimate = f"{sign}{shown.text(value.estimate, unit=True)}"
    return f"{estimate}\n{value.interval(shown.digits)}".strip()


def in_line(cell: str) -> str:
    """Return a cell in one line, its interval in brackets."""
    estimate, _, interval = cell.partition("\n")
    return f"{estimate} ({interval})" if interval else estimate


def leaderboard(answers: Answers, track: str) -> Table:
    """Return a row per policy: what it knows, success, and forces across the path."""
    trials = TRACKS[track].trials
    scored = {m: [t for t in trials if m in TRIALS[t].measures] for m in ACROSS}
    measures = [measure for measure in ACROSS if scored[measure]]
    rows = []
    for policy in ranked(answers, trials):
        knows = "that doors have a hinge" if policy in REFERENCES else "demonstrations"
        knows = "the door" if policy == "oracle" else knows
        level = levels_of(trials[0])[0]
        knows = answers[trials[0]][level][policy].get("knows", knows)
        cells = [cell(answers, trials, policy, m) for m in ("success", *measures)]
        rows.append((f"`{policy}`", knows, *cells))
    heads = [f"{MEASURES[m].title}\n{', '.join(scored[m])}" for m in measures]
    return Table(columns=("policy", "knows", "opened", *heads), rows=tuple(rows))


def verdict(answers: Answers, track: str = "learner") -> str:
    """Say whether a track measures learners, by the criteria of the protocol."""
    trials = TRACKS[track].trials
    shares = {p: by_seed(answers, trials, p) for p in ranked(answers, trials)}
    mean = shares["mean"]
    compared = {*TRACKS[track].policies}.difference(REFERENCES, ["mean"])
    learners = [policy for policy in shares if policy in compared]
    shifts = {policy: mean_shift(shares[policy], mean) for policy in learners}
    corrected = holm([signed_rank(shares[policy], mean) for policy in learners])
    apart = sum(
        p_value <= 0.05 and abs(shifts[policy].estimate) >= SMALLEST_SHARE
        for policy, p_value in zip(learners, corrected, strict=True)
    )
    best = max(learners, key=lambda policy: shifts[policy].estimate)
    opened = [in_line(cell(answers, trials, policy)) for policy in ("oracle", "mean")]
    gain = in_line(cell(answers, trials, best, than="mean")) + " points"
    leads = shifts[best].estimate >= 0.15 and shifts[best].low > 0.0
    rows = [
        ("`oracle` opens", "≥ 90 %", opened[0], fmean(shares["oracle"]) >= 0.9),
        ("`mean` opens", "≤ 60 %", opened[1], fmean(mean) <= 0.6),
        (f"best learner: `{best}` − `mean`", "≥ 15 points, interval > 0", gain, leads),
        ("separated learners", "≥ 4", f"{apart} of {len(learners)}", apart >= 4),
    ]
    heads = "criterion", "wanted", f"measured, {len(mean)} seeds", "met"
    cells = tuple((*row, "yes" if met else "no") for *row, met in rows)
    return (
        f"**These doors {'do not ' * (not all(row[-1] for row in rows))}measure "
        f"learners.**\n\n{markdown_table(Table(columns=heads, rows=cells))}"
    )


def with_results(page: str, answers: Answers) -> str:
    """Return a page with the present verdict between its marks."""
    marked = r"(?s)(?<=<!-- results: verdict -->\n).*?(?=\n<!-- end -->)"
    return re.sub(marked, lambda _: verdict(answers) if answers else NOT_RUN, page)


def main(
    files: tyro.conf.Positional[tuple[Path, ...]] = (), *, write: bool = False
) -> None:
    """Print a table per track as Markdown, or write README.md.

    Args:
        files: Files trials.json, or archives, of other people.
        write: Write the verdict between the marks of README.md.
    """
    answers = answers_of([*published(), *files])
    if write:
        readme = ROOT / "README.md"
        readme.write_text(with_results(readme.read_text(), answers))
        return
    for track in TRACKS:
        print(f"## Track {track}\n\n{markdown_table(leaderboard(answers, track))}\n")


if __name__ == "__main__":
    tyro.cli(main)
