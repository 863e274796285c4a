"""Search for doors that measure learners: python benchmarks/prototypes.py FOLDER.

Doors whose paths differ in two or more dimensions, so that none is another one's path
of another size; demonstrations like those of people; few of them; kinds without a
label. Every seed draws demonstrated and opened doors anew, equal for all policies.

Criterion, settled before the run, as in the protocol: a prototype measures learners if
`oracle` opens at least 0.9, `mean` at most 0.6 in both pipelines, and the best learner
0.15 more than `mean`. The pipelines are the default one and that without inference of
the size, in which every learner has its own form of adaptation.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean, median
from typing import Any, Final

import numpy as np
import tyro

from gplfd_env.doors.config import DoorConfig
from gplfd_env.robot.placement import base_for
from gplfd_env.robot.robots import robot_named
from gplfd_experiments.data.teacher import standard_teacher
from gplfd_experiments.episodes.task import EpisodeTask
from gplfd_experiments.files.folders import folder_in_use
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.files.provenance import code_state
from gplfd_experiments.files.table import Table, markdown_table
from gplfd_experiments.studies.engines import Engine
from gplfd_experiments.studies.runner import run_or_resume
from gplfd_experiments.studies.store import stored_results
from gplfd_experiments.studies.trials.protocol import RADIAL

LEARNERS: Final = (
    *("mean", "gp", "promp", "prodmp", "gmr", "kmp"),
    *("gmm-gp", "tp-gmm", "dmp", "local-gp"),
)
SEEDS: Final = (90, 91, 92)  # Used by nothing else.
TESTED: Final = 3  # doors per seed and kind
PERSON: Final = {  # wobbles, slips and hurries more than the standard teacher
    "wobble_position_std": 0.008,
    "wobble_rotation_std": np.radians(5.0),
    "grasp_offset_std": 0.03,
    "timing_std": 0.5,
    "duration_std": 2.0,
}
BUILDING: Final = {"latch": "spring", "handle_height": 1.0}
KINDS: Final[Mapping[str, Mapping[str, Any]]] = {
    "hinged": {"radius": (0.35, 0.65)},
    "sliding": {"motion": "sliding", "radius": (0.5, 0.85)},
    "folding": {
        "motion": "folding", "radius": (0.44, 0.68), "leaf": {"backset": (0.05, 0.24)},
    },
    "parallel": {
        "motion": "parallel-sliding", "radius": (0.45, 0.8),
        "panel_mass": (20.0, 45.0), "mechanism": {"offset": (0.02, 0.1)},
    },
    "lever": {
        "handle": "lever", **BUILDING, "radius": (0.55, 0.85),
        "lockset": {"handle_length": (0.1, 0.15), "handle_travel": (0.35, 1.1)},
    },
    "short lever": {
        "handle": "lever", **BUILDING, "radius": (0.55, 0.7),
        "lockset": {"handle_length": (0.1, 0.12), "handle_travel": (0.35, 0.6)},
    },
    "long lever": {
        "handle": "lever", **BUILDING, "radius": (0.7, 0.85),
        "lockset": {"handle_length": (0.13, 0.15), "handle_travel": (0.8, 1.1)},
    },
    "handleset": {
        "handle": "handleset", **BUILDING, "radius": (0.55, 0.85),
        "lockset": {"handle_arm": (0.05, 0.1), "handle_travel": (0.3, 0.6)},
    },
}  # fmt: skip
"""Fields of a door; a pair is a range from which every door is drawn."""
FOUR: Final = ("hinged", "folding", "sliding", "parallel")
PROTOTYPES: Final[Mapping[str, Mapping[str, Any]]] = {
    "levers": {"kinds": ("lever",)},
    "levers, 3 demonstrations": {"kinds": ("lever",), "count": 3},
    "levers, like a person": {"kinds": ("lever",), "teacher": PERSON},
    "longer levers": {"kinds": ("short lever",), "opened": ("long lever",)},
    "handlesets": {"kinds": ("handleset",)},
    "folding": {"kinds": ("folding",)},
    "folding, 2 demonstrations": {"kinds": ("folding",), "count": 2},
    "folding, like a person": {"kinds": ("folding",), "teacher": PERSON},
    "folding, stiff": {"kinds": ("folding",), "part": "constant-500"},
    "folding, noisy sensors": {
        "kinds": ("folding",), "randomization": {"pose_noise": (0.006, 0.02)},
    },
    "parallel": {"kinds": ("parallel",)},
    "four kinds": {"kinds": FOUR, "count": 8},
}  # fmt: skip


def drawn(fields: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """Return fields with a number from every range."""
    return {
        name: drawn(value, rng)
        if isinstance(value, Mapping)
        else float(rng.uniform(*value))
        if isinstance(value, tuple)
        else value
        for name, value in fields.items()
    }


def tasks_of(name: str, seed: int) -> list[EpisodeTask]:
    """Return the episodes of a prototype, of all policies."""
    prototype = PROTOTYPES[name]
    rng = np.random.default_rng([seed, list(PROTOTYPES).index(name)])
    kinds, count = prototype["kinds"], prototype.get("count", 6)
    demonstrated = [
        DoorConfig(**drawn(KINDS[kinds[number % len(kinds)]], rng))
        for number in range(count)
    ]
    doors = [
        DoorConfig(**drawn(KINDS[kind], rng))
        for kind in prototype.get("opened", kinds)
        for _ in range(1 if len(kinds) > 1 else TESTED)
    ]
    common = dict(set.intersection(*(set(door.kind.items()) for door in demonstrated)))
    hardware = [
        {n: v for n, v in door.as_dict().items() if n not in {"radius", *common}}
        for door in demonstrated
    ]
    part = prototype.get("part", "")
    pipelines = [part, "+".join(filter(None, (part, "no-size")))]
    learners = [
        f"{learner}@{pipeline}".rstrip("@")
        for pipeline in pipelines
        for learner in LEARNERS
    ]
    robot = robot_named("tiago-like")
    return [
        EpisodeTask(
            policy=policy,
            seed=seed,
            door=f"{number}",
            door_config=door.as_dict(),
            base=base_for(door, robot),
            demonstrations_per_door=1,
            teacher=standard_teacher() | prototype.get("teacher", {}),
            demonstrated_radii=[door.radius for door in demonstrated],
            demonstrated_kind=common or None,
            demonstrated_hardware=hardware,
            randomization=prototype.get("randomization", "none"),
            trial=name,
        )
        for policy in ("oracle", *learners)
        for number, door in enumerate(doors)
    ]


def main(folder: tyro.conf.Positional[Path]) -> None:
    """Run or resume all prototypes; store and print the shares of opened doors."""
    tasks = [
        task for seed in SEEDS for name in PROTOTYPES for task in tasks_of(name, seed)
    ]
    with folder_in_use(folder) as used:
        run_or_resume(tasks, {"command": "prototypes"}, used, Engine(workers=1))
        results = stored_results(used, tasks).finished
    measured: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for result in results:
        task, metrics = result["task"], result["metrics"]
        policy = task["policy"].replace("constant-500+", "")
        values = float(metrics["success"]), metrics[RADIAL]
        by_policy = measured.setdefault(task["trial"], {})
        by_policy.setdefault(policy.removesuffix("@constant-500"), []).append(values)
    rows = [
        {
            "prototype": name,
            "policy": policy,
            "episodes": len(values),
            "opened": round(fmean(opened for opened, _ in values), 3),
            "radial": round(median(force for _, force in values), 2),
        }
        for name, by_policy in measured.items()
        for policy, values in by_policy.items()
    ]
    docs = Path(__file__).parents[1] / "docs/results/prototypes.json"
    write_json(docs, {**code_state(), "rows": rows})
    print(markdown_table(table(rows)))


def table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Return per prototype the shares of the oracle, the mean, `gp` and the best."""
    lines = []
    for name in PROTOTYPES:
        of = {row["policy"]: row for row in rows if row["prototype"] == name}
        learned = [p for p in of if p.partition("@")[0] not in ("mean", "oracle")]
        best = max(learned, key=lambda policy: of[policy]["opened"])
        shown = ("oracle", "mean", "mean@no-size", "gp", "gp@no-size", best)
        cells = [f"{of[p]['opened']:.2f}, {of[p]['radial']:.1f} N" for p in shown]
        lines.append((name, *cells[:-1], f"`{best}` {cells[-1]}"))
    columns = ("", "oracle", "mean", "mean@no-size", "gp", "gp@no-size", "best")
    return Table(columns=columns, rows=tuple(lines))


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    tyro.cli(main)
