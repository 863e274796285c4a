"""Episodes in a report: summary, comparison of policies, all measures, plots."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from operator import attrgetter, methodcaller
from typing import Final

from gplfd_experiments.analysis.report import plots
from gplfd_experiments.analysis.report.document import (
    Cell,
    Section,
    code,
    literal,
    medians,
    policy_table,
)
from gplfd_experiments.analysis.results.measures import (
    ADA_FORCE,
    EPISODE_MEASURES,
    PRIVILEGED,
    TESTED,
    WALL_TIME,
    Runs,
    by_door_kind,
    closed_because,
    counted,
    door_name,
    median,
    number_text,
    numbers,
    of_split,
    ranked,
    shift_cell,
)
from gplfd_experiments.analysis.results.reading import (
    SPLITS,
    EpisodeResult,
)
from gplfd_experiments.analysis.results.statistics import (
    FEWEST_PAIRS,
    Key,
    holm,
    paired,
    shift,
    signed_rank,
    success_rate,
)
from gplfd_experiments.episodes.failures import MEANINGS
from gplfd_experiments.files.table import Table

Episodes = Sequence[EpisodeResult]

_SOLVED: Final = attrgetter("solved")
_FORCE: Final = EPISODE_MEASURES["force_radial_peak"]
_ANGLES: Final = {
    60: "door angle ever reached, with the same interval",
    30: "the same at 30°",
    15: "the same at 15°",
}
"""Angles that count as opened [deg], the task's angle first, with column meanings."""
_COLUMNS: Final[Mapping[tuple[str, ...], str]] = {
    ("time_to_60_deg", "time_to_30_deg"): "simulated time until the door was first "
    "open so far",
    ("force_tangential_peak", "force_tangential_p95"): "force along the path of the "
    "handle: peak and 95th percentile of the samples (p95)",
    ("force_radial_peak", "force_radial_p95"): "force across the path, which does no "
    "work: peak and p95",
    ("force_handle_peak", "door_acceleration_peak"): "largest force on the handle in "
    "any direction, and largest angular acceleration of the door",
    ("slip_max_mm",): "largest distance of the hand from where it grasped the handle",
    ("work",): "work of the hand on the door",
    ("prediction_error_position",): "prediction error: root of the squared distance "
    "between predicted and true position plus the stated variance, averaged over the "
    "opening",
    ("stability_margin_translation",): "smallest distance of dk/dt from its bound",
    ("latency_median_ms",): "CPU time of a call of the policy",
    (WALL_TIME,): "wall time of a call of the policy",
}
"""Meaning of a column by its metrics; the first is above the second."""
_DISTURBED: Final[Mapping[tuple[str, ...], str]] = {
    ("person_force_peak", "person_force_sustained"): "peak force on the person, and "
    "largest force sustained for 0.5 s",
    ("stop_force_peak", "stop_force_sustained"): "peak force on the stop, and "
    "largest force sustained for 0.5 s",
    ("push_displacement_mm",): "largest displacement of the hand during the push",
    ("release_speed", "recovery_time"): "largest speed of the door in the second after "
    "a disturbance, and time until it was 5° further open",
}
"""The same for effects of a disturbance, if there was one."""


def summary_table(conditions: Mapping[str, Runs]) -> Table:
    """Return a row per policy, by condition and by kind of door."""
    episodes = _all(conditions)
    splits = [
        split for split in SPLITS if any(episode.split == split for episode in episodes)
    ]

    columns = (
        "seeds",
        *(f"opened,\n{split}" for split in splits),
        *(f"radial force [N],\n{split}" for split in splits),
        "not opened because",
        "errors",
    )
    empty = ("",) * len(columns)
    several_kinds = len(by_door_kind(episodes)) > 1
    rows: list[tuple[str, ...]] = []
    for condition, runs in conditions.items():
        here = [episode for own in runs.values() for episode in own]
        for door_kind, group in by_door_kind(here).items():
            parts = [door_kind] * several_kinds + [condition] * (len(conditions) > 1)
            if parts:
                rows.append((f"**{literal(': '.join(parts))}**", *empty))
            order = ranked(group)
            rest = [
                policy
                for policy, own in order.items()
                if not any(episode.opened() for episode in own)
            ]
            for policy in sorted(order, key=rest.__contains__):
                own = order[policy]
                if rest and policy == rest[0]:
                    rows.append(("**opened no door (not ranked)**", *empty))
                rates, forces = [], []
                for split in splits:
                    some = [episode for episode in own if episode.split == split]
                    rates.append(_rate(_SOLVED, some) if some else "not run")
                    values = numbers({policy: some}, _FORCE)[policy]
                    zeros = dict.fromkeys(values, 0.0)
                    force = "none opened" if some else "not run"
                    if values:
                        typical = shift(*paired(values, zeros).per_seed())
                        force = shift_cell(typical, _FORCE.digits)
                    forces.append(force)
                cells = (
                    *(
                        str(len({episode.task.seed for episode in own})),
                        *rates,
                        *forces,
                    ),
                    literal(closed_because(own)),
                    str(sum(bool(episode.error) for episode in own)),
                )
                known = "\nknows the door" if policy in PRIVILEGED else ""
                rows.append((f"{code(policy)}{known}", *cells))
    note = (
        "**Opened:** doors opened by 60° and held there for 0.5 s with the handle in "
        "the hand, of all episodes; below it the 95 % interval (Wilson). New radii "
        "were not demonstrated; other doors differ in more than the radius. "
        "**Radial force:** peak force across the path of the handle, which does no "
        "work; a large value means that the motion does not fit the door. Typical "
        "value of a seed over the opened doors, with its 95 % interval from "
        f"{FEWEST_PAIRS} seeds on. **Errors:** episodes in which the policy raised an "
        "error; they count as not opened. Policies are in order of the doors opened "
        "to 60°, then of the radial force."
    )
    return Table(columns=("policy", *columns), rows=tuple(rows), note=note)


def doors_section(conditions: Mapping[str, Runs], reference: str) -> Section:
    """All measures of all conditions, with lost episodes; plots of the first one."""
    section = Section("Doors opened", "doors")
    title, all_runs = next(iter(conditions.items()))
    runs = counted(all_runs)
    several = len(conditions) > 1
    section.say(f"Plots: {title}." if several else f"{title}.")
    section.picture(
        "success",
        partial(plots.success_by_radius, runs, reference),
        "**Doors opened to 60° by the handle's radius,** with Wilson's 95 % intervals. "
        "Blue stripes: radii that were demonstrated. Pale violet: "
        f"{code(reference)}. Policies in order of success, then of radial force; other "
        "doors are left out.",
        "Success rate against radius, a panel per policy",
    )
    section.picture(
        "radial_force",
        partial(plots.force_by_radius, runs, reference),
        "**Peak radial force on the doors opened to 60°:** a dot per episode, a line "
        "through the medians. It does no work and shows how badly the path fits the "
        "door. Red: the 22.2 N of ADA 404.2.9.",
        "Peak radial force against radius, a panel per policy",
    )
    forecasts = (
        episode.metrics["forecast_error_mm"] for own in runs.values() for episode in own
    )
    if any(error is not None for errors in forecasts for error in errors):
        section.picture(
            "forecast",
            partial(plots.forecast_by_progress, runs, reference),
            "**Error of the forecast of the rest of the path** as the door opens: "
            "median and middle half of all episodes, those included that failed later. "
            "A falling curve: the policy adapts to the door.",
            "Forecast error against progress, a panel per policy",
        )

    columns = _columns(conditions)
    cells = {head: cell for head, (cell, _) in columns.items()}
    note = (
        "Medians: forces, slip and work over the doors opened to 60°, the others over "
        "all episodes that have them. A policy that opens few doors has few numbers: "
        "the paired tests compare equal doors."
    )
    section.table(policy_table(conditions, cells, note), folded="All measures")
    meanings = tuple((head, said) for head, (_, said) in columns.items() if said)
    table = Table(columns=("column", "meaning"), rows=meanings, left=True)
    section.table(table, folded="What the columns mean")
    by_split = {
        f"{split}: {title}" if several else split: group
        for title, own in conditions.items()
        for split in SPLITS
        if any((group := of_split(own, split)).values())
    }
    section.table(policy_table(by_split, cells), folded="By kind of door")

    def at_door(door: str, own: Episodes) -> str:
        here = [episode for episode in own if door_name(episode) == door]
        if not here:
            return "–"
        opened = [episode for episode in here if episode.opened()]
        rate = _rate(_SOLVED, here)
        if len(opened) != sum(map(_SOLVED, here)):
            rate += f"\nto 60°: {len(opened)}"
        return f"{rate}\n{_FORCE.text(_FORCE.median(opened), unit=True)}"

    doors = sorted(
        {(episode.radius, door_name(episode)) for episode in _all(conditions)}
    )
    by_door: dict[str, Cell] = {
        literal(door): partial(at_door, door) for _, door in doors
    }
    note = (
        "Solved / ran with Wilson's 95 % interval, how many were opened to 60° if not "
        "as many, and the median peak radial force of these [N]."
    )
    section.table(policy_table(conditions, by_door, note), folded="Door by door")
    return section


def _columns(conditions: Mapping[str, Runs]) -> dict[str, tuple[Cell, str]]:
    """Return the column of every measure and its meaning, by its heading."""
    episodes = _all(conditions)
    disturbed = [episode for episode in episodes if episode.task.disturbance != "none"]

    def above(own: Episodes) -> str:
        opened = [episode for episode in own if episode.opened()]
        forces = ("force_tangential_peak", "force_radial_peak")
        count = sum(
            any((episode.number(force) or 0.0) > ADA_FORCE for force in forces)
            for episode in opened
        )
        return f"{count}/{len(opened)}" if opened else "–"

    def failed(failure: str, own: Episodes) -> str:
        return str(
            sum(episode.failure == failure for episode in own if not episode.solved)
        )

    def angles(own: Episodes) -> str:
        known = EPISODE_MEASURES["final_angle_deg"].values(own)
        return f"{median(known):.1f}°\n{max(known):.1f}°" if known else "–"

    columns: dict[str, tuple[Cell, str]] = {
        "solved": (
            partial(_rate, _SOLVED),
            "open by 60° and held there for 0.5 s with the handle in the hand, of all "
            "that ran; below it the 95 % interval (Wilson's, wider where doors of a "
            "seed are alike)",
        )
    }
    for angle, meaning in _ANGLES.items():
        opened = partial(_rate, methodcaller("opened", angle))
        columns[f"to {angle}°"] = opened, meaning
    measured = dict(_COLUMNS)
    for metrics, meaning in _DISTURBED.items():
        if any(episode.number(metrics[0]) for episode in disturbed):
            measured[metrics] = meaning
    for metrics, meaning in measured.items():
        column = medians(*(EPISODE_MEASURES[metric] for metric in metrics))
        columns |= {head: (cell, meaning) for head, cell in column.items()}
    columns[f"above {ADA_FORCE} N"] = (
        above,
        "opened doors with a peak force, tangential or radial, above the limit of ADA "
        "404.2.9 for opening an interior door",
    )
    for failure in sorted(
        {episode.failure for episode in episodes if not episode.solved}
    ):
        columns[literal(failure)] = partial(failed, failure), MEANINGS.get(failure, "")
    columns["median angle\nlargest"] = angles, "door angle at the end of the episode"
    return columns


def tests_section(conditions: Mapping[str, Runs], reference: str) -> Section:
    """Paired tests of every condition."""
    section = Section("Paired tests", "tests")
    for title, runs in conditions.items():
        if len(conditions) > 1:
            section.say(f"**{title[0].upper()}{title[1:]}**")
        if reference in runs and len(runs) > 1:
            against = f"{reference} against each other policy"
            section.table(_paired_tests(runs, reference), folded=against)
        else:
            section.say(f"There is nothing to compare {code(reference)} with.")
    return section


def _paired_tests(runs: Runs, reference: str) -> Table:
    """Compare the reference with every other policy on the same tasks."""
    tested = [EPISODE_MEASURES[name] for name in TESTED]
    measured: dict[str, Mapping[str, Mapping[Key, float]]] = {
        "opened to 60°": _successes(runs),
        **{measure.column: numbers(runs, measure) for measure in tested},
    }
    digits = {measure.column: measure.digits for measure in tested}
    cells: dict[str, list[str]] = {other: [] for other in runs if other != reference}
    for title, values in measured.items():
        pairs = {other: paired(values[reference], values[other]) for other in cells}
        both = [other for other in cells if pairs[other].seeds]
        corrected = holm([signed_rank(*pairs[other].per_seed()) for other in both])
        for other, p in zip(both, corrected, strict=True):
            pair = pairs[other]
            if title in digits:
                typical = shift(*pair.per_seed()).estimate
                text = number_text(typical, digits[title], signed=True)
            else:
                doors = list(zip(pair.first, pair.second, strict=True))
                won, lost = sum(a > b for a, b in doors), sum(b > a for a, b in doors)
                text = f"{won} : {lost}"
            said = "p < 0.001" if p < 1e-3 else f"p {p:.3f}"
            said = f"**{said}**" if p < 0.05 else said
            cells[other].append(f"{text}\n{said}, n {len(set(pair.seeds))}")
        for other in cells.keys() - both:
            cells[other].append("–")
    note = (
        f"{code(reference)} against each other policy on the same doors and seeds. "
        f"Success: doors that only one of the two opened ({code(reference)} : other). "
        f"Numbers: {code(reference)} minus the other on doors that both opened, after "
        "Hodges and Lehmann; – where there is none. Both are tested by Wilcoxon's "
        "signed ranks of the mean difference of each seed, as doors of a seed share "
        "what was learned from. p after Holm for all tests of a column; n seeds."
    )
    rows = tuple((code(other), *own) for other, own in cells.items())
    return Table(columns=("against", *measured), rows=rows, note=note)


def _successes(runs: Runs) -> dict[str, dict[Key, bool]]:
    """Return by policy and task whether the door was opened to 60 degrees."""
    return {
        policy: {episode.key: episode.opened() for episode in episodes}
        for policy, episodes in runs.items()
    }


def _rate(succeeds: Callable[[EpisodeResult], bool], own: Episodes) -> str:
    return success_rate((episode.task.seed, succeeds(episode)) for episode in own).cell


def _all(conditions: Mapping[str, Runs]) -> list[EpisodeResult]:
    """Return all episodes that count, of all conditions."""
    runs = (own for each in conditions.values() for own in each.values())
    return [episode for own in runs for episode in own if episode.counts]
