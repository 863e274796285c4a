"""What was run: the command, the code, the counts, and what went wrong."""

import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from gplfd_experiments.analysis.report.document import (
    Block,
    Items,
    Paragraph,
    Section,
    Verbatim,
    code,
    literal,
    names,
)
from gplfd_experiments.analysis.results.grouping import by_policy, grouped
from gplfd_experiments.analysis.results.records import (
    EpisodeResult,
    StudyResults,
    TaskResult,
)
from gplfd_experiments.analysis.results.table import remarks
from gplfd_experiments.studies.store import PLANNED

TITLE = "What was run"
_LEFT_OUT = "Files without a result, left out"


def header(results: StudyResults) -> tuple[Block, ...]:
    """Say what is missing, and where every number comes from."""
    warnings = [literal(said) for said in remarks(results.episodes)]
    if failed := sum(bool(one.error) for one in results.tests):
        tests = f"{failed} of {len(results.tests)} learning tests ended in an error."
        warnings.append(tests)
    if mixed := _of_several_sources(results.all):
        warnings.append(f"Results of {names(mixed)} were made by more than one source.")
    planned = results.study.get(PLANNED)
    if isinstance(planned, int) and len(results.all) < planned:
        warnings.append(
            f"{planned - len(results.all)} of {planned} tasks have no result: run the "
            "study again."
        )
    if results.unreadable:
        warnings.append(f"{_LEFT_OUT}: {len(results.unreadable)}.")
    warning = " ".join(filter(None, warnings))
    started = results.study.get("created")
    command = results.study.get("command")
    parts = (
        (results.episodes, "episodes"),
        (results.tests, "learning tests"),
        (results.recorded, "recordings left out"),
    )
    done = " and ".join(f"{len(own)} {what}" for own, what in parts if own)
    blocks: list[Block] = [
        Paragraph(
            text=f"{done} of {len(by_policy(results.all))} policies"
            + (f", started {literal(started)}" if isinstance(started, str) else "")
            + ". Every number on this page is computed from the result files of"
        ),
        Verbatim(
            text=shlex.join(map(str, command))
            if isinstance(command, list) and command
            else "(study.json with the command is missing)"
        ),
    ]
    if warning:
        text = f"{warning} The reasons are under “{TITLE}”."
        blocks.insert(0, Paragraph(text=text, warning=True))
    return tuple(blocks)


def origin_section(results: StudyResults) -> Section:
    """Provenance, counts, errors and what could not be read."""
    blocks: list[Block] = [
        *_code(results.all),
        *_machines(results.all),
        *_sources(results.all),
        *_machine(results.study),
        *_gaps(results.episodes),
        *_errors(results.all),
    ]
    if results.unreadable:
        blocks.append(Paragraph(text=f"{_LEFT_OUT}:", warning=True))
        blocks.append(Verbatim(text="\n".join(results.unreadable)))
    return Section(title=TITLE, anchor="origin", blocks=tuple(blocks))


def _code(results: Sequence[TaskResult]) -> list[Block]:
    codes = Counter(one.code for one in results).most_common()
    if len(codes) == 1:
        return [Paragraph(text=f"All results were made by {literal(codes[0][0])}.")]
    listed = sorted(codes, key=lambda item: (-item[1], item[0]))
    return [
        Paragraph(
            text="These results were not all made by the same code; differences "
            "between policies may be differences between versions. Use another --out, "
            "or delete the folder, to have one version.",
            warning=True,
        ),
        Items(texts=tuple(f"{n} results: {literal(text)}" for text, n in listed)),
    ]


def _machines(results: Sequence[TaskResult]) -> list[Block]:
    if (kinds := len({one.machine for one in results})) < 2:
        return []
    text = (
        f"These results were made on {kinds} kinds of machine: they are comparable to "
        f"a tolerance only, see {code('docs/reproducibility.md')}."
    )
    return [Paragraph(text=text)]


def _sources(results: Sequence[TaskResult]) -> list[Block]:
    """Where the policies came from that are not this project's."""
    own = grouped(results, lambda one: (one.policy, one.policy_source))
    texts = [f"{code(policy)}: {code(source)}" for policy, source in own if source]
    blocks: list[Block] = []
    if texts:
        blocks.append(Paragraph(text="Policies that are not this project's:"))
        blocks.append(Items(texts=tuple(texts)))
    return blocks


def _of_several_sources(results: Sequence[TaskResult]) -> list[str]:
    """Return the policies whose file was edited between two parts of a study."""
    sources = {(one.policy, one.policy_source) for one in results}
    times = Counter(policy for policy, _ in sources)
    return sorted(policy for policy, number in times.items() if number > 1)


def _machine(study: Mapping[str, Any]) -> list[Block]:
    texts = []
    for title, key, form in (
        ("Machine", "platform", "{} {}"),
        ("Settings of the last command", "config", "{} = {}"),
    ):
        entries = study.get(key)
        if isinstance(entries, dict):
            parts = (form.format(name, _value(each)) for name, each in entries.items())
            texts.append(f"{title}: {literal('; '.join(parts))}.")
    return [Items(texts=tuple(texts))] if texts else []


def _value(value: object) -> str:
    return " ".join(map(str, value)) if isinstance(value, list) else str(value)


def _gaps(episodes: Sequence[EpisodeResult]) -> list[Block]:
    """Tasks that some policies ran and others did not."""
    every = {one.pair for one in episodes}
    gaps = {
        policy: missing
        for policy, own in by_policy(episodes).items()
        if (missing := len(every - {one.pair for one in own}))
    }
    if not gaps:
        return []
    listed = ", ".join(f"{code(policy)} {count}" for policy, count in gaps.items())
    return [
        Paragraph(
            text=f"Of the {len(every)} episodes that any policy ran, some have none: "
            f"{listed}. Rates count what was run; tests compare what both ran.",
            warning=True,
        )
    ]


def _errors(results: Sequence[TaskResult]) -> list[Block]:
    failed = [one for one in results if one.error]
    if not failed:
        return [Paragraph(text="No task ended in an error.")]
    reasons = grouped(failed, lambda one: one.error)
    rows = sorted(reasons.items(), key=lambda item: (-len(item[1]), item[0]))
    listed = (f"{len(own)} × {_where(own)}: {reason}" for reason, own in rows)
    text = f"Tasks of {names(by_policy(failed))} that ended in an error:"
    return [Paragraph(text=text, warning=True), Verbatim(text="\n".join(listed))]


def _where(failed: Sequence[TaskResult]) -> str:
    tasks = (f"{one.policy}, {_subject(one)}" for one in failed)
    return "; ".join(dict.fromkeys(tasks))


def _subject(one: TaskResult) -> str:
    return one.task.door if isinstance(one, EpisodeResult) else "learning test"
