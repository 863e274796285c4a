"""The leaderboards of the trials: python benchmarks/leaderboard.py.

Reads trials.json, which `gplfd report` writes for `gplfd trials`. Ranks the policies
that took part in all trials of a tier by the share of doors that they opened. Policies
in the files of other people are ranked with them.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any, Final

import tyro

from gplfd_experiments.analysis.results.measures import EPISODE_MEASURES
from gplfd_experiments.analysis.results.statistics import holm, signed_rank
from gplfd_experiments.analysis.results.trials import deciding_measure, success_measure
from gplfd_experiments.files.plain_data import read_json
from gplfd_experiments.files.table import Table, markdown_table
from gplfd_experiments.studies.trials.protocol import REFERENCES, TIERS, TRIALS

PROTOCOL: Final = 9
"""Protocol of the stored results."""
STORED: Final = Path(__file__).parents[1] / f"docs/results/trials-v{PROTOCOL}.json"
"""Results of the whole protocol."""
GROUPS: Final[Mapping[str, Sequence[str]]] = {
    **{f"Tier {tier}": names for tier, names in TIERS.items()},
    "All trials of hinged furniture": [
        name
        for name, trial in TRIALS.items()
        if not (name.startswith("forces-") or trial.only_policies)
    ],
}
"""Trials of each table by its title."""
_UNTAUGHT: Final = (*REFERENCES, "mechanism-fit")
"""Policies that learn nothing."""

Answers = Mapping[str, Mapping[str, Mapping[str, Any]]]
"""Measures by trial, level and policy."""


def answers_of(files: Iterable[Path]) -> Answers:
    """Return what files hold together; of a policy in several what the first says.

    Raises ValueError for a file of another protocol.
    """
    answers: dict[str, dict[str, dict[str, Any]]] = {}
    for file in files:
        content = read_json(file)
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


def levels_of(name: str) -> tuple[str, ...]:
    """Return a trial's levels but those that give a prior mean, which not all take."""
    levels = TRIALS[name].levels.items()
    return tuple(level for level, setting in levels if setting.prior_radius is None)


def entrants(answers: Answers, names: Sequence[str]) -> list[str]:
    """Return the policies that took part in all trials, the most successful first.

    Those of which the machine lost an episode have no place: nobody knows its outcome.
    """
    complete = [
        {
            policy
            for policy, numbers in answers.get(name, {}).get(level, {}).items()
            if not numbers["lost"]
        }
        for name in names
        for level in levels_of(name)
    ]
    everywhere = sorted(set.intersection(*complete))
    return sorted(everywhere, key=lambda policy: -succeeded(answers, names, policy))


def mean(answers: Answers, name: str, policy: str, measure: str) -> float | None:
    """Return the mean of a measure over the levels of a trial that have it."""
    levels = [answers[name][level][policy][measure] for level in levels_of(name)]
    values = [numbers["estimate"] for numbers in levels]
    measured = [value for value in values if value is not None]
    return fmean(measured) if measured else None


def share(answers: Answers, name: str, policy: str) -> float:
    """Return the share of successes of a policy in a trial."""
    value = mean(answers, name, policy, success_measure(TRIALS[name]))
    assert value is not None
    return value


def succeeded(answers: Answers, names: Sequence[str], policy: str) -> float:
    """Return the mean share of successes of a policy in several trials."""
    return fmean(share(answers, name, policy) for name in names)


def titled(policy: str) -> str:
    """Return the cell with the name of a policy."""
    return f"`{policy}`{' (learns nothing)' if policy in _UNTAUGHT else ''}"


def leaderboard(answers: Answers, names: Sequence[str]) -> Table:
    """Return a row per policy: the share of successes, and what decides, by trial."""
    policies = entrants(answers, names)
    cells = {
        policy: [f"{succeeded(answers, names, policy):.2f}"] for policy in policies
    }
    for name in names:
        measure = EPISODE_MEASURES[deciding_measure(TRIALS[name])]
        values = {
            policy: mean(answers, name, policy, measure.metric) for policy in policies
        }
        learned = [
            value
            for policy, value in values.items()
            if value is not None and policy not in _UNTAUGHT
        ]
        best = (min if measure.better == "less" else max)(learned)
        for policy, value in values.items():
            finer = -1 if measure.unit == "°" else 0
            text = measure.text(value, unit=True, finer=finer)
            if value == best and policy not in _UNTAUGHT:
                text = f"**{text}**"
            cells[policy].append(f"{share(answers, name, policy):.2f}\n{text}")
    rows = tuple((titled(policy), *cells[policy]) for policy in policies)
    return Table(columns=("policy", "all", *names), rows=rows)


def overview(answers: Answers) -> Table:
    """Return the share of successes of every policy in several tiers, by tier."""
    shares = {
        tier: {
            policy: succeeded(answers, names, policy)
            for policy in entrants(answers, names)
        }
        for tier, names in TIERS.items()
    }
    by_policy: dict[str, list[float | None]] = {
        policy: [tier.get(policy) for tier in shares.values()]
        for policy in sorted({policy for tier in shares.values() for policy in tier})
    }

    def order(policy: str) -> tuple[int, float]:
        present = [value for value in by_policy[policy] if value is not None]
        return -len(present), -fmean(present)

    rows = tuple(
        (titled(policy), *("–" if v is None else f"{v:.2f}" for v in by_policy[policy]))
        for policy in sorted(by_policy, key=order)
        if len(shares) - by_policy[policy].count(None) >= 2
    )
    return Table(columns=("policy", *shares), rows=rows)


def separated(answers: Answers, names: Sequence[str]) -> str:
    """Say which policies' shares of successes differ from those of gp, seed by seed."""

    def by_seed(policy: str) -> list[float]:
        cells = [
            answers[name][level][policy][success_measure(TRIALS[name])]["seeds"]
            for name in names
            for level in levels_of(name)
        ]
        return [fmean(values) for values in zip(*cells, strict=True)]

    others = [policy for policy in entrants(answers, names) if policy != "gp"]
    gp = by_seed("gp")
    corrected = holm([signed_rank(gp, by_seed(policy)) for policy in others])
    groups: dict[str, list[str]] = {"more": [], "less": [], "not separated": []}
    for policy, p_value in zip(others, corrected, strict=True):
        better = fmean(by_seed(policy)) > fmean(gp)
        group = ("more" if better else "less") if p_value <= 0.05 else "not separated"
        groups[group].append(f"`{policy}`")
    text = "; ".join(f"{name}: {', '.join(who)}" for name, who in groups.items() if who)
    return f"Compared with `gp` (signed ranks of {len(gp)} seeds, Holm, 5 %), {text}."


def main(files: tyro.conf.Positional[tuple[Path, ...]] = ()) -> None:
    """Print Markdown: an overview, a table per tier, and one of all hinged furniture.

    Args:
        files: Files trials.json of other people.
    """
    answers = answers_of([STORED, *files])
    print(f"## All tiers\n\n{markdown_table(overview(answers))}\n")
    for title, names in GROUPS.items():
        table = markdown_table(leaderboard(answers, names))
        print(f"## {title}\n\n{table}\n\n{separated(answers, names)}\n")


if __name__ == "__main__":
    tyro.cli(main)
