"""The leaderboard of the trials: python benchmarks/leaderboard.py.

From what `gplfd report` kept of `gplfd trials`, trials.json: every policy that took
part in all trials, by the doors that it opened. Files of others are put beside, and a
policy of theirs has its place.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any, Final

import tyro

from gplfd_experiments.analysis.results.trials import SHARES
from gplfd_experiments.files.plain_data import read_json
from gplfd_experiments.files.table import Table, markdown_table
from gplfd_experiments.studies.trials.protocol import REFERENCES, TRIALS
from gplfd_experiments.studies.trials.records import MEASURES

Answers = Mapping[str, Any]
"""What a trials.json holds of a policy at a level of a trial."""
Found = Mapping[str, Mapping[str, Mapping[str, Answers]]]
"""The same by trial, level and policy."""

PROTOCOL: Final = 2
"""The latest protocol of which all policies have results."""
STORED: Final = Path(__file__).parents[1] / f"docs/results/trials-v{PROTOCOL}.json"
"""Of the whole protocol, run for the documents."""
RANKED: Final = {
    name: trial for name, trial in TRIALS.items() if not name.startswith("forces-")
}
"""Trials of this protocol; a later one added those with demonstrated forces."""

_SHORT: Final = {
    "final_angle_deg": "°",
    "push_displacement_mm": " mm",
}
"""Units in a cell; the others are forces."""


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


def entrants(found: Found) -> list[str]:
    """Return the policies that took part in every trial, the most successful first.

    Those of which the machine lost an episode have no place: nobody knows its outcome.
    """
    levels = [
        found.get(name, {}).get(level, {})
        for name in RANKED
        for level in levels_of(name)
    ]
    sets = [
        {one for one, own in held.items() if not own.get("lost")} for held in levels
    ]
    everywhere = sorted(set.intersection(*sets))
    return sorted(everywhere, key=lambda policy: -_succeeded(found, policy))


def _mean(found: Found, name: str, policy: str, measure: str) -> float | None:
    """Return the mean of a measure over the levels of a trial that have it."""
    values = [found[name][one][policy][measure]["estimate"] for one in levels_of(name)]
    there = [value for value in values if value is not None]
    return fmean(there) if there else None


def _share(found: Found, name: str, policy: str) -> float:
    share = next(one for one in TRIALS[name].measures if one in SHARES)
    value = _mean(found, name, policy, share)
    assert value is not None
    return value


def _succeeded(found: Found, policy: str) -> float:
    return fmean(_share(found, name, policy) for name in RANKED)


def leaderboard(found: Found) -> Table:
    """Return a row per policy: the share of successes, and what decides, by trial."""
    policies = entrants(found)
    cells = {policy: [f"{_succeeded(found, policy):.2f}"] for policy in policies}
    for name, trial in RANKED.items():
        measures = (contrast.measure for contrast in trial.contrasts)
        measure = next(one for one in measures if one not in SHARES)
        values = {one: _mean(found, name, one, measure) for one in policies}
        learned = [
            value
            for one, value in values.items()
            if value is not None and one not in REFERENCES
        ]
        best = (min if MEASURES[measure][1] == "less" else max)(learned)
        for one, value in values.items():
            unit = _SHORT.get(measure, " N")
            text = "–" if value is None else f"{value:.{1 - (unit == '°')}f}{unit}"
            if value == best and one not in REFERENCES:
                text = f"**{text}**"
            cells[one].append(f"{_share(found, name, one):.2f}\n{text}")
    rows = []
    for policy in policies:
        told = " (learns nothing)" if policy in REFERENCES else ""
        rows.append((f"`{policy}`{told}", *cells[policy]))
    return Table(columns=("policy", "all", *RANKED), rows=tuple(rows))


def main(files: tyro.conf.Positional[tuple[Path, ...]] = ()) -> None:
    """Print the leaderboard as Markdown.

    Args:
        files: What `gplfd report` kept of the trials of others, trials.json.
    """
    print(markdown_table(leaderboard(answers_of([STORED, *files]))))


if __name__ == "__main__":
    tyro.cli(main)
