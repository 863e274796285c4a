"""What was run: the command, the code, the counts, and errors."""

import shlex
from collections import Counter
from typing import Final

from gplfd_experiments.analysis.report.document import Section, code, literal, names
from gplfd_experiments.analysis.results.measures import by_policy, grouped
from gplfd_experiments.analysis.results.reading import (
    EpisodeResult,
    StudyResults,
    TaskResult,
)
from gplfd_experiments.analysis.results.table import remarks
from gplfd_experiments.files.table import Table
from gplfd_experiments.studies.store import PLANNED

_TITLE: Final = "What was run"
_LEFT_OUT: Final = "Files without a result, left out"


def say_warnings(lead: Section, results: StudyResults) -> None:
    """Add a paragraph with important warnings, if there are any."""
    warnings = [literal(said) for said in remarks(results.episodes)]
    if failed := sum(bool(result.error) for result in results.tests):
        tests = f"{failed} of {len(results.tests)} learning tests ended in an error."
        warnings.append(tests)
    # A file that was edited between two parts of a study.
    sources = Counter(policy for policy, _ in _sources(results))
    if mixed := sorted(policy for policy, number in sources.items() if number > 1):
        warnings.append(
            f"Results of {names(mixed)} come from more than one source file or version."
        )
    if missing := unfinished(results):
        warnings.append(f"{missing}.")
    if results.unreadable:
        warnings.append(f"{_LEFT_OUT}: {len(results.unreadable)}.")
    if warnings:
        text = f"{' '.join(warnings)} The reasons are under “{_TITLE}”."
        lead.say(text, warning=True)


def unfinished(results: StudyResults) -> str:
    """Return the number of planned tasks without a result; empty if there is none."""
    planned = results.study.get(PLANNED)
    if not isinstance(planned, int) or len(results.all) >= planned:
        return ""
    missing = planned - len(results.all)
    return f"{missing} of {planned} tasks have no result: run the study again"


def say_command(lead: Section, results: StudyResults) -> None:
    """State the number of results, and the command that made them."""
    parts = (
        (results.episodes, "episodes"),
        (results.tests, "learning tests"),
        (results.recorded, "recordings left out"),
    )
    done = " and ".join(f"{len(own)} {what}" for own, what in parts if own)
    created, command = results.study.get("created"), results.study.get("command")
    started = f", started {literal(created)}" if isinstance(created, str) else ""
    lead.say(
        f"{done} of {len(by_policy(results.all))} policies{started}. Every number on "
        "this page is computed from the result files of"
    )
    lead.verbatim(
        shlex.join(map(str, command))
        if isinstance(command, list) and command
        else "(study.json with the command is missing)"
    )


def origin_section(results: StudyResults) -> Section:
    """Provenance, counts, errors and what could not be read."""
    section = Section(_TITLE, "origin")

    codes = Counter(result.code for result in results.all)
    if len(codes) == 1:
        section.say(f"All results were made by {literal(next(iter(codes)))}.")
    else:
        section.say(
            "These results were not all made by the same code; differences between "
            "policies may be differences between versions. Use another --out, or "
            "delete the folder, to have one version.",
            warning=True,
        )
        listed = sorted(codes.items(), key=lambda item: (-item[1], item[0]))
        section.items(f"{n} results: {literal(each)}" for each, n in listed)
    machines = {result.machine for result in results.all}
    if len(machines) > 1:
        section.say(
            f"These results were made on {len(machines)} kinds of machine: they are "
            "equal only up to a tolerance, see `docs/reproducibility.md`."
        )

    if own := [(policy, source) for policy, source in _sources(results) if source]:
        section.say("Policies that are not this project's:")
        section.items(f"{code(policy)}: {code(source)}" for policy, source in own)

    for title, key in (
        ("Machine", "platform"),
        ("Settings of the last command", "config"),
    ):
        if isinstance(entries := results.study.get(key), dict):
            cells = tuple((literal(name), literal(entries[name])) for name in entries)
            table = Table(columns=("name", "value"), rows=cells, left=True)
            section.table(table, folded=title)

    # Tasks that only some policies ran.
    every = {result.pair for result in results.episodes}
    gaps = [
        f"{code(policy)} {missing}"
        for policy, episodes in by_policy(results.episodes).items()
        if (missing := len(every - {result.pair for result in episodes}))
    ]
    if gaps:
        section.say(
            f"Of the {len(every)} episodes that any policy ran, some have none: "
            f"{', '.join(gaps)}. Rates count what was run; tests compare what both "
            "ran.",
            warning=True,
        )

    if failed := [result for result in results.all if result.error]:
        reasons = grouped(failed, lambda result: result.error)
        rows = sorted(reasons.items(), key=lambda item: (-len(item[1]), item[0]))
        text = f"Tasks of {names(by_policy(failed))} that ended in an error:"
        section.say(text, warning=True)
        section.verbatim(
            "\n".join(
                f"{len(own)} × {'; '.join(dict.fromkeys(map(_subject, own)))}: {reason}"
                for reason, own in rows
            )
        )
    else:
        section.say("No task ended in an error.")
    if results.unreadable:
        section.say(f"{_LEFT_OUT}:", warning=True)
        section.verbatim("\n".join(results.unreadable))
    return section


def _sources(results: StudyResults) -> list[tuple[str, str]]:
    """Return every policy with each of its sources, in order."""
    return list(
        dict.fromkeys((result.policy, result.policy_source) for result in results.all)
    )


def _subject(result: TaskResult) -> str:
    what = result.task.door if isinstance(result, EpisodeResult) else "learning test"
    return f"{result.policy}, {what}"
