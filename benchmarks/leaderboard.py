"""The leaderboards of the trials: python benchmarks/leaderboard.py.

Reads trials.json, which `gplfd report` writes for `gplfd trials`. Ranks the policies
that took part in all trials of a tier by the share of doors that they opened. Policies
in the files of other people are ranked with them.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any, Final

import tyro

from gplfd_experiments.analysis.results.measures import EPISODE_MEASURES
from gplfd_experiments.analysis.results.statistics import holm, signed_rank
from gplfd_experiments.analysis.results.trials import deciding_measure, success_measure
from gplfd_experiments.files.plain_data import read_json
from gplfd_experiments.files.table import Table, markdown_table
from gplfd_experiments.studies.trials.protocol import REFERENCES, TRIALS
from gplfd_experiments.studies.trials.tiers import TIERS

Answers = Mapping[str, Any]
"""What a trials.json holds of a policy at a level of a trial."""
Found = Mapping[str, Mapping[str, Mapping[str, Answers]]]
"""The same by trial, level and policy."""

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


def answers_of(files: Sequence[Path]) -> Found:
    """Return what files hold together; of a policy in several what the first says.

    Raises ValueError for a file of another protocol, or one that leaves out episodes in
    which a policy raised an error.
    """
    found: dict[str, dict[str, dict[str, Answers]]] = {}
    for file in files:
        held = read_json(file)
        if held.get("protocol") != PROTOCOL:
            raise ValueError(
                f"{file} is of protocol {held.get('protocol')}, and the leaderboard of "
                f"{PROTOCOL}: run the trials again"
            )
        for trial, levels in held["trials"].items():
            for level, policies in levels.items():
                for policy, own in policies.items():
                    # Files that do not say what was lost leave errors out of rates.
                    if own["errors"] and "lost" not in own:
                        raise ValueError(
                            f"{file} leaves out episodes in which {policy} raised an "
                            "error; run `gplfd report` again on its results"
                        )
                here = found.setdefault(trial, {}).setdefault(level, {})
                found[trial][level] = dict(policies) | here
    return found


def levels_of(name: str) -> tuple[str, ...]:
    """Return a trial's levels but those that give a prior mean, which not all take."""
    levels = TRIALS[name].levels.items()
    return tuple(level for level, setting in levels if setting.prior_radius is None)


def entrants(found: Found, names: Sequence[str]) -> list[str]:
    """Return the policies that took part in all trials, the most successful first.

    Those of which the machine lost an episode have no place: nobody knows its outcome.
    """
    levels = [
        found.get(name, {}).get(level, {})
        for name in names
        for level in levels_of(name)
    ]
    sets = [
        {one for one, own in held.items() if not own.get("lost")} for held in levels
    ]
    everywhere = sorted(set.intersection(*sets))
    return sorted(everywhere, key=lambda policy: -_succeeded(found, names, policy))


def _mean(found: Found, name: str, policy: str, measure: str) -> float | None:
    """Return the mean of a measure over the levels of a trial that have it."""
    values = [found[name][one][policy][measure]["estimate"] for one in levels_of(name)]
    there = [value for value in values if value is not None]
    return fmean(there) if there else None


def _share(found: Found, name: str, policy: str) -> float:
    value = _mean(found, name, policy, success_measure(TRIALS[name]))
    assert value is not None
    return value


def _succeeded(found: Found, names: Sequence[str], policy: str) -> float:
    return fmean(_share(found, name, policy) for name in names)


def leaderboard(found: Found, names: Sequence[str]) -> Table:
    """Return a row per policy: the share of successes, and what decides, by trial."""
    policies = entrants(found, names)
    cells = {one: [f"{_succeeded(found, names, one):.2f}"] for one in policies}
    for name in names:
        measure = deciding_measure(TRIALS[name])
        values = {one: _mean(found, name, one, measure) for one in policies}
        learned = [
            value
            for one, value in values.items()
            if value is not None and one not in _UNTAUGHT
        ]
        measured = EPISODE_MEASURES[measure]
        best = (min if measured.better == "less" else max)(learned)
        for one, value in values.items():
            finer = -1 if measured.unit == "°" else 0
            text = measured.text(value, unit=True, finer=finer)
            if value == best and one not in _UNTAUGHT:
                text = f"**{text}**"
            cells[one].append(f"{_share(found, name, one):.2f}\n{text}")
    rows = []
    for policy in policies:
        told = " (learns nothing)" if policy in _UNTAUGHT else ""
        rows.append((f"`{policy}`{told}", *cells[policy]))
    return Table(columns=("policy", "all", *names), rows=tuple(rows))


def overview(found: Found) -> Table:
    """Return the share of successes of every policy in several tiers, by tier."""
    shares = {
        tier: {one: _succeeded(found, names, one) for one in entrants(found, names)}
        for tier, names in TIERS.items()
    }
    policies = sorted({one for held in shares.values() for one in held})

    def order(policy: str) -> tuple[int, float]:
        own = [held[policy] for held in shares.values() if policy in held]
        return -len(own), -fmean(own)

    rows = []
    for policy in sorted(policies, key=order):
        own = [held.get(policy) for held in shares.values()]
        if len(own) - own.count(None) < 2:
            continue
        told = " (learns nothing)" if policy in _UNTAUGHT else ""
        cells = ("–" if one is None else f"{one:.2f}" for one in own)
        rows.append((f"`{policy}`{told}", *cells))
    return Table(columns=("policy", *shares), rows=tuple(rows))


def separated(found: Found, names: Sequence[str]) -> str:
    """Say which policies' shares of successes differ from those of gp, seed by seed."""
    policies = entrants(found, names)

    def by_seed(policy: str) -> list[float]:
        cells = [
            found[name][level][policy][success_measure(TRIALS[name])]["seeds"]
            for name in names
            for level in levels_of(name)
        ]
        return [fmean(values) for values in zip(*cells, strict=True)]

    others, own = [one for one in policies if one != "gp"], by_seed("gp")
    corrected = holm([signed_rank(own, by_seed(one)) for one in others])
    groups: dict[str, list[str]] = {"more": [], "less": [], "not separated": []}
    for policy, p_value in zip(others, corrected, strict=True):
        better = fmean(by_seed(policy)) > fmean(own)
        group = ("more" if better else "less") if p_value <= 0.05 else "not separated"
        groups[group].append(f"`{policy}`")
    said = "; ".join(f"{one}: {', '.join(who)}" for one, who in groups.items() if who)
    return f"Compared with `gp` (signed ranks of {len(own)} seeds, Holm, 5 %), {said}."


def main(files: tyro.conf.Positional[tuple[Path, ...]] = ()) -> None:
    """Print Markdown: an overview, a table per tier, and one of all hinged furniture.

    Args:
        files: Files trials.json of other people.
    """
    found = answers_of([STORED, *files])
    print(f"## All tiers\n\n{markdown_table(overview(found))}\n")
    for title, names in GROUPS.items():
        table = markdown_table(leaderboard(found, names))
        print(f"## {title}\n\n{table}\n\n{separated(found, names)}\n")


if __name__ == "__main__":
    tyro.cli(main)
