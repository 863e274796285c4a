"""What was run: the command, the code, the counts, and what went wrong."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Mapping
from typing import Any

from experiments.report.document import (
    Block,
    Items,
    Paragraph,
    Section,
    Table,
    Verbatim,
)
from experiments.results.grouping import by_condition, by_policy, named
from experiments.results.records import Outcome, StudyResults


def header(results: StudyResults) -> tuple[Block, ...]:
    """Where every number comes from."""
    study, outcomes = results.study, results.outcomes
    failed = sum(bool(one.error) for one in outcomes)
    blocks: list[Block] = [
        Paragraph(
            text=f"{len(results.episodes)} episodes and {len(results.tests)} learning "
            f"tests of {len(by_policy(outcomes))} policies"
            + (f", started {study['created']}" if "created" in study else "")
            + (f"; **{failed} ended in an error**" if failed else "; no errors")
            + ". Every number on this page is computed from the result files of"
        ),
        Verbatim(text=_command(study)),
    ]
    return tuple(blocks)


def _command(study: Mapping[str, Any]) -> str:
    command = study.get("command")
    if not isinstance(command, list) or not command:
        return "(study.json with the command is missing)"
    return shlex.join(map(str, command))


def origin_section(results: StudyResults) -> Section:
    """Provenance, counts, errors and warnings."""
    blocks: list[Block] = [*_code(results)]
    if results.study:
        blocks.append(Items(texts=_machine(results.study)))
    blocks.append(_counts(results))
    blocks.extend(_gaps(results))
    blocks.extend(_errors(results))
    if results.unreadable:
        blocks.append(
            Paragraph(
                text=f"{len(results.unreadable)} files hold no result and are left "
                "out:",
                warning=True,
            )
        )
        blocks.append(Verbatim(text="\n".join(results.unreadable)))
    return Section(title="What was run", anchor="origin", blocks=tuple(blocks))


def _code(results: StudyResults) -> list[Block]:
    codes = Counter(one.code for one in results.outcomes)
    if len(codes) == 1:
        return [Paragraph(text=f"All results were made by {next(iter(codes))}.")]
    listed = sorted(codes.items(), key=lambda item: (-item[1], item[0]))
    return [
        Paragraph(
            text="These results were not all made by the same code; differences "
            "between policies may be differences between versions. Use another --out, "
            "or delete the folder, to have one version.",
            warning=True,
        ),
        Items(texts=tuple(f"{count} results: {code}" for code, count in listed)),
    ]


def _machine(study: Mapping[str, Any]) -> tuple[str, ...]:
    texts = []
    platform = study.get("platform")
    if isinstance(platform, Mapping):
        told = ", ".join(f"{name} {value}" for name, value in platform.items())
        texts.append(f"Machine: {told}.")
    settings = study.get("config")
    if isinstance(settings, Mapping):
        told = "; ".join(
            f"{name} = {_value(value)}" for name, value in settings.items()
        )
        texts.append(f"Settings of the last command: {told}.")
    return tuple(texts)


def _value(value: object) -> str:
    if isinstance(value, list):
        return " ".join(map(str, value))
    return str(value)


def _counts(results: StudyResults) -> Table:
    conditions = list(by_condition(results.episodes))
    rows = []
    for policy, own in by_policy(results.outcomes).items():
        episodes = [one for one in results.episodes if one.policy == policy]
        tests = [one for one in results.tests if one.policy == policy]
        rows.append(
            (
                f"`{policy}`",
                *(
                    str(sum(one.condition == condition for one in episodes))
                    for condition in conditions
                ),
                str(len(tests)),
                str(sum(bool(one.error) for one in own)),
            )
        )
    heads = (f"episodes: {condition}" for condition in conditions)
    return Table(
        columns=("policy", *heads, "learning tests", "errors"), rows=tuple(rows)
    )


def _gaps(results: StudyResults) -> list[Block]:
    """Tasks that some policies ran and others did not."""
    every = {one.pair for one in results.episodes}
    gaps = {
        policy: missing
        for policy, own in by_policy(results.episodes).items()
        if (missing := len(every - {one.pair for one in own}))
    }
    if not gaps:
        return []
    listed = ", ".join(f"`{policy}` {count}" for policy, count in gaps.items())
    return [
        Paragraph(
            text=f"Of the {len(every)} episodes that any policy ran, some have none: "
            f"{listed}. Rates count what was run; tests compare what both ran.",
            warning=True,
        )
    ]


def _errors(results: StudyResults) -> list[Block]:
    failed = [one for one in results.outcomes if one.error]
    if not failed:
        return [Paragraph(text="No task ended in an error.")]
    reasons: dict[str, list[Outcome]] = {}
    for one in failed:
        reasons.setdefault(one.error, []).append(one)
    rows = sorted(reasons.items(), key=lambda item: (-len(item[1]), item[0]))
    told = "\n".join(
        f"{len(group)} × {_plainly(group)}: {reason}" for reason, group in rows
    )
    return [
        Paragraph(
            text=f"{len(failed)} tasks ended in an error, of "
            f"{named(by_policy(failed))}. An episode that ended in an error counts as "
            "a door not opened.",
            warning=True,
        ),
        Verbatim(text=told),
    ]


def _plainly(group: list[Outcome]) -> str:
    kinds = Counter(
        f"{one.policy}, {one.task.get('door') or 'learning test'}" for one in group
    )
    return "; ".join(kinds)
