"""Numbers of result files in the pages: a hook of MkDocs.

``{{ FILE / … }}`` becomes a number of docs/results/FILE.json, and a line
``<!-- results: NAME -->`` the table or text of `BLOCKS` with this name:

    {{ trials / TRIAL / LEVEL / POLICY / MEASURE }}    value, then its interval
    {{ trials / TRIAL / LEVEL / POLICY / opened }}     doors opened, of how many
    {{ trials / TRACK / POLICY / MEASURE }}            the same over a track
    {{ trials / TRIAL / with – without / MEASURE }}    a contrast
    {{ trials / episodes }}                            their number
    {{ FILE / POLICY }}                                    doors opened, of rows
    {{ scored / TRIAL }}                                   the measures of a condition;
                                                           those of contrasts in italics

Every measure has one statistic, that of benchmarks/leaderboard.py. As long as a file
does not exist, its numbers are "not run yet"; a name that it lacks is an error.
"""

import functools
import itertools
import re
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any, Final

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
import leaderboard as board

import gplfd_policies
from gplfd_experiments.analysis.results.statistics import number_text
from gplfd_experiments.analysis.results.trials import MEASURES, success_measure
from gplfd_experiments.files.plain_data import read_json
from gplfd_experiments.files.table import Table, markdown_table
from gplfd_experiments.studies.trials.protocol import TRACKS, TRIALS, Trial

RESULTS: Final = Path(__file__).with_name("results")
TUNED: Final = Path(gplfd_policies.__file__).with_name("registry") / "tuned.json"
MACRO: Final = re.compile(r"\{\{ ([^{}]+) \}\}")
BLOCK: Final = re.compile(r"<!-- results: ([\w -]+?) -->(?:\n.*?\n<!-- end -->)?", re.S)


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Put the numbers of results into a page."""
    return written(markdown, page.file.src_uri)


def written(markdown: str, name: str) -> str:
    """Return a page with numbers; raise KeyError with its name and the macro."""

    def with_name(write: Callable[[str], str]) -> Callable[[re.Match[str]], str]:
        def put(mark: re.Match[str]) -> str:
            try:
                return write(mark[1])
            except (KeyError, ValueError, IndexError) as error:
                raise KeyError(f"{name}: {mark[0]}: no result {error}") from error

        return put

    return MACRO.sub(with_name(number), BLOCK.sub(with_name(block), markdown))


def number(macro: str) -> str:
    """Return what a macro asks for."""
    file, *where = (part.strip() for part in macro.split(" / "))
    if file == "scored":
        trial = TRIALS[where[0]]
        compared = {contrast.measure for contrast in trial.contrasts}
        names = [(m, MEASURES[m].name) for m in trial.measures]
        return "; ".join(f"*{name}*" if m in compared else name for m, name in names)
    path = RESULTS / f"{file}.json"
    if not path.exists():
        return board.NOT_RUN
    content = _content(path, path.stat().st_mtime_ns)
    if "trials" not in content:
        return _opened_of_rows(content["rows"], *where)
    if where == ["episodes"]:
        levels = itertools.chain(*(of.values() for of in content["trials"].values()))
        return f"{sum(p['episodes'] for at in levels for p in at.values()):,}"
    *place, measure = where
    if " – " in place[-1]:
        return _contrast(content["contrasts"], place[0], place[-1], measure)
    if place[0] in TRACKS:
        value = board.cell(
            content["trials"], TRACKS[place[0]].trials, place[1], measure
        )
        return board.in_line(value)
    trial, level, policy = place
    results = content["trials"][trial][level][policy]
    if measure == "opened":
        doors = results["episodes"]
        return f"{round(results['success']['estimate'] * doors)} of {doors}"
    return _with_interval(results[measure], measure)


@functools.cache
def _content(path: Path, changed_at: int) -> Any:
    """Read a file once: the pages have hundreds of numbers of it."""
    return read_json(path)


def _with_interval(result: Mapping[str, Any], name: str) -> str:
    """Return an estimate with its unit, and its interval in brackets."""
    measure = MEASURES[name]
    scale, digits = (100.0, 0) if measure.share else (1.0, measure.digits)
    unit = "%" if measure.share else measure.unit
    space = " " * (unit not in ("", "°"))
    ends = [result[end] for end in ("estimate", "low", "high")]
    texts = [number_text(scale * x, digits) for x in ends if x is not None]
    interval = f" ({texts[1]} to {texts[2]})" if len(texts) == 3 else ""
    return f"{texts[0]}{space}{unit}{interval}" if texts else "–"


def _contrast(contrasts: Any, trial: str, sides: str, measure: str) -> str:
    """Return the difference of two policies, its interval, and p after Holm."""
    having, lacking = sides.split(" – ")
    wanted = (trial, having, lacking, measure)
    for row in contrasts:
        if (row["trial"], row["with"], row["without"], row["measure"]) == wanted:
            text = _with_interval(row, measure).replace(" %", " points")
            shown = MEASURES[measure]
            digits = 2 if shown.share else shown.digits
            plus = "+" * (round(row["estimate"] or 0.0, digits) > 0.0)
            return f"{plus}{text}, {_p(row['p'])}"
    raise KeyError(sides)


def _p(value: float) -> str:
    return "p < 0.001" if value < 0.001 else f"p {value:.3f}"


def _opened_of_rows(rows: Any, policy: str) -> str:
    """Return how many doors a policy opened, of all in the rows."""
    outcomes = [_opened(row, rows) for row in rows if row["policy"] == policy]
    if not outcomes:
        raise KeyError(policy)
    if isinstance(outcomes[0], bool):
        return f"{sum(outcomes)} of {len(outcomes)} episodes"
    return f"{100.0 * fmean(outcomes):.0f} %"


def _opened(row: Mapping[str, Any], rows: Any) -> bool | float:
    """Return whether a door was opened, or their share; an error opens none."""
    if isinstance(row["opened"], bool):
        return row["opened"]
    name = row["prototype"]
    planned = max(other["episodes"] for other in rows if other["prototype"] == name)
    return float(row["opened"] * row["episodes"] / planned)


def by_trial(answers: board.Answers, track: str) -> Table:
    """Return a row per policy: success and the first other measure in every trial."""
    trials = {}
    for trial in TRACKS[track].trials:
        numbers = (m for m in TRIALS[trial].measures if not MEASURES[m].share)
        trials[trial] = "success", next(numbers)
    rows = []
    for policy in board.ranked(answers, [*trials]):
        cells = [
            "\n".join(board.cell(answers, [trial], policy, m) for m in measures)
            for trial, measures in trials.items()
        ]
        rows.append((f"`{policy}`", *cells))
    heads = (
        "\n".join((f"`{trial}`", *(_column(m, TRIALS[trial]) for m in measures)))
        for trial, measures in trials.items()
    )
    return Table(columns=("policy", *heads), rows=tuple(rows))


def _column(measure: str, trial: Trial) -> str:
    """Return what a number of a trial is, with its unit."""
    shown = MEASURES[success_measure(trial) if measure == "success" else measure]
    return shown.short if shown.share else shown.title


def parts(answers: board.Answers) -> Table:
    """Return what every part of the pipeline adds to the doors opened, by trial."""
    trials, rows = TRACKS["pipeline"].trials, []
    for less in (p for p in TRACKS["pipeline"].policies if "@" in p):
        policy = less.partition("@")[0]
        both = [t for t in trials if {policy, less} <= board.ran(answers, t)]
        cells = [
            board.cell(answers, of, policy, than=less)
            for of in (both, *([t] for t in trials))
        ]
        rows.append((f"`{policy}` − `{less}`", *cells))
    heads = ("with − without", "all of these", *(f"`{trial}`" for trial in trials))
    return Table(columns=heads, rows=tuple(rows))


def overview(answers: board.Answers) -> Table:
    """Return the success of every policy that is in two tracks, by track."""
    tracks = {name: track.trials for name, track in TRACKS.items()}
    counts = Counter(
        p for trials in tracks.values() for p in board.ranked(answers, trials)
    )
    rows = [
        (
            f"`{policy}`",
            *(board.cell(answers, trials, policy) for trials in tracks.values()),
        )
        for policy, count in counts.items()
        if count > 1
    ]
    return Table(columns=("policy", *tracks), rows=tuple(rows))


def contrasts(track: str) -> str:
    """Return every contrast of a track, and the smallest p that they can have."""
    words = {"shows": "better with it", "harms": "worse with it", "open": "–"}
    content = read_json(board.STORED)
    family = [
        row
        for row in content["contrasts"]
        # As in answers_by_trial: a trial in two tracks counts in the second.
        if [t for t, of in TRACKS.items() if row["trial"] in of.trials][-1] == track
    ]
    rows = [
        (
            row["idea"],
            f"`{row['trial']}`",
            f"`{row['with']}` – `{row['without']}`",
            MEASURES[row["measure"]].name,
            number(
                f"{board.STORED.stem} / {row['trial']} / "
                f"{row['with']} – {row['without']} / {row['measure']}"
            ),
            words[row["verdict"]],
        )
        for row in family
    ]
    heads = ("idea", "condition", "with – without", "measure", "difference", "verdict")
    table = markdown_table(Table(columns=heads, rows=tuple(rows), left=True))
    first = next(iter(content["trials"].values()))
    seeds = len(next(iter(next(iter(first.values())).values()))["success"]["seeds"])
    least = len(rows) * 2.0 ** (1 - seeds)
    return (
        f"{table}\n\n*Contrasts of the track {track}. {seeds} seeds and {len(rows)} "
        f"contrasts allow no p below {least:.1g} ({len(rows)} · 2 / 2^{seeds}).*"
    )


def prototypes() -> Table:
    """Return doors opened and radial force at every prototype of the search."""
    shown = ("oracle", "mean", "mean@no-size", "gp", "gp@no-size")
    rows: dict[str, dict[str, Mapping[str, Any]]] = {}
    run = read_json(RESULTS / "prototypes.json")["rows"]
    for row in run:
        counted = {**row, "opened": _opened(row, run)}
        rows.setdefault(row["prototype"], {})[row["policy"]] = counted

    def cell(row: Mapping[str, Any]) -> str:
        return f"{100.0 * row['opened']:.0f} %\n{row['radial']:.1f} N"

    lines = []
    for name, policies in rows.items():
        learners = [
            p for p in policies if p.partition("@")[0] not in ("oracle", "mean")
        ]
        # Of equal shares that with the smallest force.
        best = min(
            learners, key=lambda p: (-policies[p]["opened"], policies[p]["radial"])
        )
        cells = [cell(policies[policy]) for policy in shown]
        lines.append((name, *cells, f"`{best}`\n{cell(policies[best])}"))
    heads = (f"`{policy}`" for policy in shown)
    return Table(columns=("prototype", *heads, "best other learner"), rows=tuple(lines))


def robustness() -> Table | str:
    """Return shares and forces of the learners in every variant of their track."""
    path = RESULTS / "robustness.json"
    if not path.exists():
        return board.NOT_RUN
    content, measures = read_json(path), ("success", "force_radial_20ms")
    variants, taus = content["numbers"], content["kendall"]

    def cell(numbers: Mapping[str, float] | None) -> str:
        if numbers is None:
            return "–"
        return f"{100.0 * numbers[measures[0]]:.0f} %\n{numbers[measures[1]]:.1f} N"

    rows = [
        (f"`{policy}`", *(cell(numbers.get(policy)) for numbers in variants.values()))
        for policy in next(iter(variants.values()))
    ]
    pairs = ([taus.get(name, {}).get(m) for m in measures] for name in variants)
    texts = (
        "\n".join("–" if t is None else f"{t:.2f}" for t in pair) for pair in pairs
    )
    return Table(columns=("policy", *variants), rows=(*rows, ("Kendall's tau", *texts)))


def pictures() -> Table | str:
    """Return the doors that ACT opens with and without pictures, by track.

    A cell has the mean and the range of the three seeds, each another training.
    """
    path = RESULTS / "pictures.json"
    if not path.exists():
        return board.NOT_RUN
    answers = read_json(path)["trials"]
    tracks = {name: of.trials for name, of in TRACKS.items() if name != "corrections"}
    rows = []
    for number, arm in itertools.product((6, 50, 200), ("", "-compliant")):
        for kind in ("act", "act-pictures"):
            policy = f"{kind}-{number}{arm}"
            cells = []
            for trials in tracks.values():
                cell = "–"
                if all(policy in board.ran(answers, trial) for trial in trials):
                    seeds = board.by_seed(answers, trials, policy)
                    low, mean, high = (100.0 * f(seeds) for f in (min, fmean, max))
                    cell = f"{mean:.0f} %\n{low:.0f} to {high:.0f}"
                cells.append(cell)
            seen = "pictures too" if kind != "act" else "state and wrench"
            how = "admittance" if arm else "stiff arm"
            rows.append((f"`learner-{number}`", seen, how, *cells))
    heads = ("set", "sees", "arm", *tracks)
    return Table(columns=heads, rows=tuple(rows))


def tuning() -> Table | str:
    """Return what tuning found: shipped and tuned settings of each learner."""
    learners = read_json(TUNED)["policies"]
    rows = []
    for learner, ways in learners.items():
        for way, title in (("published", "shipped"), ("tuned", "tuned")):
            density, closed, force = ways[way]["values"]
            settings = ways[way]["settings"].items()
            text = ", ".join(f"`{name}` {value:.3g}" for name, value in settings)
            numbers = (number_text(density, 2), f"{closed:.0f}", f"{force:.2f}")
            rows.append((f"`{learner}`", title, *numbers, text))
    heads = ("learner", "settings", "NLPD", "closed of 18", "force [N]", "values")
    return Table(columns=heads, rows=tuple(rows)) if rows else board.NOT_RUN


@functools.cache  # many tables are of the same files
def _answers(files: Sequence[Path]) -> board.Answers:
    return board.answers_of(files)


def _of_answers(make: Callable[..., Table | str]) -> Callable[..., Table | str]:
    """Return what makes a table of the present protocol, once it was run."""

    def made(*track: str) -> Table | str:
        if not board.STORED.exists():
            return board.NOT_RUN
        return make(_answers(tuple(board.published())), *track)

    return made


BLOCKS: Final[Mapping[str, Callable[..., Table | str]]] = {
    "contrasts": _of_answers(lambda _, track: contrasts(track)),
    "parts": _of_answers(parts),
    "pictures": pictures,
    "prototypes": prototypes,
    "robustness": robustness,
    "track": _of_answers(board.leaderboard),
    "tracks": _of_answers(overview),
    "trials": _of_answers(by_trial),
    "tuning": tuning,
    "verdict": _of_answers(board.verdict),
}
"""Tables and texts by the first word of the names that pages use; some need a track."""


def block(name: str) -> str:
    """Return a table or text of the results as Markdown."""
    kind, *track = name.split()
    if kind not in BLOCKS or not set(track) <= set(TRACKS):
        raise KeyError(name)
    made = BLOCKS[kind](*track)
    return made if isinstance(made, str) else markdown_table(made)
