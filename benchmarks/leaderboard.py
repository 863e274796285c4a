"""The leaderboards of the trials: python benchmarks/leaderboard.py.

From what `gplfd report` kept of `gplfd trials`, trials.json: every policy that took
part in all trials of a tier, or of protocol v2, by the doors that it opened. Files of
others are put beside those of the same protocol, and a policy of theirs has its place.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any, Final

import tyro

from gplfd_experiments.analysis.results.measures import EPISODE_MEASURES
from gplfd_experiments.analysis.results.statistics import holm, signed_rank
from gplfd_experiments.analysis.results.trials import graded, share_of
from gplfd_experiments.files.plain_data import read_json
from gplfd_experiments.files.table import Table, markdown_table
from gplfd_experiments.studies.trials.protocol import REFERENCES, TRIALS
from gplfd_experiments.studies.trials.tiers import TIERS

Answers = Mapping[str, Any]
"""What a trials.json holds of a policy at a level of a trial."""
Found = Mapping[str, Mapping[str, Mapping[str, Answers]]]
"""The same by trial, level and policy."""

PROTOCOL: Final = 2
"""The latest protocol of which all policies have results."""
STORED: Final = Path(__file__).parents[1] / f"docs/results/trials-v{PROTOCOL}.json"
"""Of the whole protocol, run for the documents."""
RANKED: Final = {
    name: trial
    for name, trial in TRIALS.items()
    if not (name.startswith("forces-") or trial.among)
}
"""Trials of this protocol; later ones added those with demonstrated forces, and those
with policies of their own."""
_UNTAUGHT: Final = (*REFERENCES, "mechanism-fit")
"""Policies that learn nothing."""


def answers_of(files: Sequence[Path], protocol: int = PROTOCOL) -> Found:
    """Return what files hold together; of a policy in several what the first says.

    Raises ValueError for a file of another protocol, or one that leaves out episodes in
    which a policy raised an error.
    """
    found: dict[str, dict[str, dict[str, Answers]]] = {}
    for file in files:
        held = read_json(file)
        if held.get("protocol") != protocol:
            raise ValueError(
                f"{file} is of protocol {held.get('protocol')}, and the leaderboard of "
                f"{protocol}: run the trials again"
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
    value = _mean(found, name, policy, share_of(TRIALS[name]))
    assert value is not None
    return value


def _succeeded(found: Found, names: Sequence[str], policy: str) -> float:
    return fmean(_share(found, name, policy) for name in names)


def leaderboard(found: Found, names: Sequence[str]) -> Table:
    """Return a row per policy: the share of successes, and what decides, by trial."""
    policies = entrants(found, names)
    cells = {one: [f"{_succeeded(found, names, one):.2f}"] for one in policies}
    for name in names:
        measure = graded(TRIALS[name])
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


def separated(found: Found, names: Sequence[str]) -> str:
    """Say which policies' shares of successes differ from those of gp, seed by seed."""
    policies = entrants(found, names)

    def by_seed(policy: str) -> list[float]:
        cells = [
            found[name][level][policy][share_of(TRIALS[name])]["seeds"]
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
    """Print the leaderboards as Markdown: tiers by the latest results, and protocol v2.

    Args:
        files: What `gplfd report` kept of the trials of others, trials.json.
    """
    held = {
        path: read_json(path) for path in (*STORED.parent.glob("trials-*.json"), *files)
    }
    left = set(files)
    for tier, names in {**TIERS, "": tuple(RANKED)}.items():
        if not names:
            continue
        complete = [one for one in held.values() if {*names} <= one["trials"].keys()]
        protocol = max(one["protocol"] for one in complete) if tier else PROTOCOL
        stored = STORED.with_name(f"trials-v{protocol}.json")
        own = [file for file in files if held[file]["protocol"] == protocol]
        left -= set(own)
        table = leaderboard(answers_of([stored, *own], protocol), names)
        title = f"Tier {tier}" if tier else "All trials"
        print(f"## {title}, protocol v{protocol}\n\n{markdown_table(table)}\n")
        if tier:
            print(separated(answers_of([stored, *own], protocol), names) + "\n")
    if left:
        raise ValueError(f"no table is of the protocol of {', '.join(map(str, left))}")


if __name__ == "__main__":
    tyro.cli(main)
