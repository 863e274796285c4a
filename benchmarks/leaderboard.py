"""The leaderboards of the trials: python benchmarks/leaderboard.py.

Ranks the policies that took part in all trials of a track by the share of doors that
they opened, from trials.json, which `gplfd report` writes for `gplfd trials`.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any, Final

import tyro

from gplfd_experiments.analysis.results.measures import EPISODE_MEASURES
from gplfd_experiments.analysis.results.statistics import holm, mean_shift, signed_rank
from gplfd_experiments.analysis.results.trials import deciding_measure, success_measure
from gplfd_experiments.files.plain_data import read_json
from gplfd_experiments.files.table import Table, markdown_table
from gplfd_experiments.studies.trials.protocol import REFERENCES, TRACKS, TRIALS

SMALLEST_SHARE: Final = 0.05
"""Smallest difference of shares of successes that counts."""
PROTOCOL: Final = 10  # of the stored results
STORED: Final = Path(__file__).parents[1] / f"docs/results/trials-v{PROTOCOL}.json"


Answers = Mapping[str, Mapping[str, Mapping[str, Any]]]
"""Measures by trial, level and policy."""
Numbers = Mapping[str, tuple[float, float | None]]
"""Share of successes and deciding measure of a policy, by trial."""


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


def levels_of(names: Sequence[str]) -> list[tuple[str, str]]:
    """Return trials and levels but those with a prior mean, which not all take."""
    return [
        (name, level)
        for name in names
        for level, setting in TRIALS[name].levels.items()
        if setting.prior_radius is None
    ]


def standings(
    answers: Answers, names: Sequence[str], *, pipelines: bool = False
) -> dict[str, Numbers]:
    """Return the policies that took part in all trials, the most successful first.

    Those of which the machine lost an episode have no place: nobody knows its outcome.
    Policies in another pipeline than the default one have a table of their own.
    """
    results = [answers.get(name, {}).get(level, {}) for name, level in levels_of(names)]
    complete = [
        {p for p in policies if not policies[p]["lost"] and ("@" in p) == pipelines}
        for policies in results
    ]

    def mean(policy: str, name: str, measure: str) -> float | None:
        """Return the mean of a measure over the levels of a trial that have it."""
        levels = [answers[name][level][policy] for _, level in levels_of([name])]
        values = [measures[measure]["estimate"] for measures in levels]
        measured = [value for value in values if value is not None]
        return fmean(measured) if measured else None

    numbers = {
        policy: {
            name: (
                mean(policy, name, success_measure(TRIALS[name])) or 0.0,
                mean(policy, name, deciding_measure(TRIALS[name])),
            )
            for name in names
        }
        for policy in sorted(set.intersection(*complete))
    }
    return dict(sorted(numbers.items(), key=lambda item: -succeeded(item[1])))


def succeeded(numbers: Numbers) -> float:
    """Return the mean share of successes of a policy over trials."""
    return fmean(share for share, _ in numbers.values())


def titled(policy: str) -> str:
    """Return the cell with the name of a policy."""
    return f"`{policy}`{' (learns nothing)' if policy in REFERENCES else ''}"


def leaderboard(answers: Answers, names: Sequence[str]) -> Table:
    """Return a row per policy: the share of successes, and what decides, by trial."""
    places = standings(answers, names)
    learned = [policy for policy in places if policy not in REFERENCES]
    rows = {p: [titled(p), f"{succeeded(places[p]):.2f}"] for p in places}
    for name in names:
        measure = EPISODE_MEASURES[deciding_measure(TRIALS[name])]
        values = [value for p in learned if (value := places[p][name][1]) is not None]
        best = max(values, key=lambda value: measure.sign * value)
        finer = -1 if measure.unit == "°" else 0
        for policy, numbers in places.items():
            share, value = numbers[name]
            text = measure.text(value, unit=True, finer=finer)
            if value == best and policy in learned:
                text = f"**{text}**"
            rows[policy].append(f"{share:.2f}\n{text}")
    columns = ("policy", "all", *names)
    return Table(columns=columns, rows=tuple(map(tuple, rows.values())))


def overview(answers: Answers, *, pipelines: bool = False) -> Table:
    """Return the share of successes of every policy in several tracks, by track.

    Of learners in the default pipeline and of references, or of other pipelines.
    """
    shares: dict[str, dict[str, float]] = {}
    for track, names in TRACKS.items():
        for policy, numbers in standings(answers, names, pipelines=pipelines).items():
            shares.setdefault(policy, {})[track] = succeeded(numbers)

    rows = []
    order = sorted(shares, key=lambda p: (-len(shares[p]), -fmean(shares[p].values())))
    for policy in order:
        if len(tracks := shares[policy]) >= 2:
            cells = [
                f"{tracks[track]:.2f}" if track in tracks else "–" for track in TRACKS
            ]
            rows.append((titled(policy), *cells))
    return Table(columns=("policy", *TRACKS), rows=tuple(rows))


def separated(answers: Answers, names: Sequence[str]) -> str:
    """Compare learners with the mean, seed by seed, by the protocol's criteria."""
    shares: dict[str, list[float]] = {}
    for policy in standings(answers, names):
        successes = [
            answers[name][level][policy][success_measure(TRIALS[name])]["seeds"]
            for name, level in levels_of(names)
        ]
        common = sorted(set.intersection(*map(set, successes)))
        shares[policy] = [fmean(share[seed] for share in successes) for seed in common]
    learned = {p: seeds for p, seeds in shares.items() if p not in REFERENCES}
    mean = learned.pop("mean")
    shifts = {policy: mean_shift(seeds, mean) for policy, seeds in learned.items()}
    corrected = holm([signed_rank(seeds, mean) for seeds in learned.values()])
    groups: dict[str, list[str]] = {"more": [], "less": [], "not separated": []}
    for (policy, shift), p_value in zip(shifts.items(), corrected, strict=True):
        differs = p_value <= 0.05 and abs(shift.estimate) >= SMALLEST_SHARE
        better = "more" if shift.estimate > 0.0 else "less"
        groups[better if differs else "not separated"].append(f"`{policy}`")
    text = "; ".join(f"{name}: {', '.join(who)}" for name, who in groups.items() if who)
    best = max(shifts, key=lambda policy: shifts[policy].estimate)
    lead, known = shifts[best], fmean(shares["oracle"])
    apart = len(groups["more"]) + len(groups["less"])
    measures = known >= 0.9 and lead.estimate >= 0.15 and lead.low > 0.0 and apart >= 4
    verdict = "measure" if measures else "do not measure"
    ends = " to ".join(f"{100 * end:+.0f}" for end in (lead.low, lead.high))
    known_to = f"95 % interval {ends}" if math.isfinite(lead.low) else "few seeds"
    return (
        f"Compared with the mean of the demonstrations (signed ranks of {len(mean)} "
        f"seeds, Holm, 5 %, at least {100 * SMALLEST_SHARE:.0f} points), {text}. The "
        f"best learner, `{best}`, opens {100 * lead.estimate:+.0f} points more than "
        f"the mean ({known_to}); `oracle` opens {known:.2f}. By the "
        f"criteria of the protocol these doors {verdict} learners."
    )


def main(files: tyro.conf.Positional[tuple[Path, ...]] = ()) -> None:
    """Print Markdown: overviews of learners and of pipelines, and a table per track.

    Args:
        files: Files trials.json of other people.
    """
    answers = answers_of([STORED, *files])
    print(f"## All tracks\n\n{markdown_table(overview(answers))}\n")
    if (others := overview(answers, pipelines=True)).rows:
        print(f"## Other pipelines\n\n{markdown_table(others)}\n")
    for track, names in TRACKS.items():
        if standings(answers, names):  # Others are not run yet.
            table = markdown_table(leaderboard(answers, names))
            print(f"## Track {track}\n\n{table}\n\n{separated(answers, names)}\n")


if __name__ == "__main__":
    tyro.cli(main)
