"""A gallery: videos and curves of episodes in a web page, two policies side by side.

The page needs no server: its data are a script, `DATA`. A later run of the same command
reads it, keeps its episodes and adds the missing ones.
"""

import contextlib
import itertools
import math
import shlex
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import numpy as np

from gplfd_env.doors.config import DOORS
from gplfd_experiments.console.arguments import check_folder, check_least
from gplfd_experiments.console.progress import counter
from gplfd_experiments.episodes.build import (
    learned_agents,
    make_environment,
    reported_errors,
)
from gplfd_experiments.episodes.failures import why_closed
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.episodes.rollout import rollout
from gplfd_experiments.episodes.task import EpisodeTask, episode_task, named_doors
from gplfd_experiments.files.names import file_name
from gplfd_experiments.files.plain_data import (
    check_stamp,
    entry,
    json_text,
    naming,
    parsed_json,
    stamp,
)
from gplfd_experiments.files.provenance import provenance
from gplfd_experiments.recording.video import VideoFormat, check_video, write_video
from gplfd_experiments.studies.sources import source_of
from gplfd_policies.agents.agent import Agent
from gplfd_policies.arrays.storage import complete_or_absent
from gplfd_policies.registry.catalogue import policy_named

PAGE: Final = "index.html"
DATA: Final = "episodes.js"
FORMAT: Final = VideoFormat(
    size=(256, 192),
    rate=10,
    last=0.0,
    encoding=("-crf", "31", "-preset", "veryslow", "-movflags", "+faststart"),
)
"""Format of the videos: about 10 kB each."""
NUMBERS: Final = (
    *("success", "duration", "final_angle_deg", "time_to_60_deg"),
    *("force_radial_peak", "force_handle_peak"),
)
"""Metrics beside a video."""
_ASSIGNED: Final = "const GALLERY = "
_STAMP: Final = stamp("a gplfd gallery", 1)


def write_gallery(
    doors: Sequence[str],
    policies: Sequence[str],
    folder: Path,
    *,
    seed: int,
    options: Mapping[str, Any],
) -> int:
    """Add missing episodes to the gallery in a folder; return the number of episodes.

    The page is valid after every episode. Raises ValueError before anything is written
    for an unknown door or policy, or a folder with another page.
    """
    check_least("--seed", seed, 0)
    chosen = {name: policy_named(name) for name in policies}
    tasks: dict[str, tuple[EpisodeTask, str]] = {}
    given = doors or tuple(DOORS)
    for text, (door, config) in zip(given, named_doors(given).items(), strict=True):
        for name, policy in chosen.items():
            fields = {"policy": name, "policy_source": source_of(policy), "seed": seed}
            task = episode_task(door, config, **fields)
            tasks[task.key] = task, text
    check_video()
    check_folder(folder)
    made, known = _read(folder)
    lacking = [task for key, (task, _) in tasks.items() if key not in known]
    # A policy learns once for doors of a kind.
    lacking.sort(key=lambda task: (task.demonstrations_key, task.training_key))
    if lacking:
        made.append(provenance(options))
    with counter("episode", len(tasks), len(tasks) - len(lacking)) as bar:
        for _, alike in itertools.groupby(lacking, lambda task: task.training_key):
            first, *others = alike
            with reported_errors(first.policy, chosen[first.policy]):
                make = learned_agents(first, chosen[first.policy])
                for task in (first, *others):
                    door = tasks[task.key][1]
                    again = ["gplfd", "run", "--doors", door, "--policy", task.policy]
                    again += ["--seed", str(seed), "--out", "results/shown"]
                    known[task.key] = {
                        "task": task.key,
                        **_filmed(task, make(), folder),
                        "run": shlex.join(again),
                        "made": len(made) - 1,
                    }
                    _write(folder, made, known, [*tasks])
                    bar.update()
    _write(folder, made, known, [*tasks])
    return len(known)


def _filmed(task: EpisodeTask, agent: Agent, folder: Path) -> dict[str, Any]:
    """Run an episode, write its video, and return its data for the page."""
    name = "-".join(map(file_name, (task.door, task.policy, str(task.seed))))
    with contextlib.closing(make_environment(task, agent.control)) as env:
        log = rollout(
            env,
            agent,
            policy=task.policy,
            door=task.door,
            seed=task.reset_seed,
            forecast_period=math.inf,
        )
        model = env.unwrapped.model  # type: ignore[attr-defined]
        pictures = write_video(folder / f"{name}.mp4", log, model, FORMAT)
    measured, rows = episode_metrics(log).as_json(), FORMAT.rows(log)
    # The largest force since the previous picture, so that no peak is lost.
    since = np.minimum(np.append(0, rows[:-1] + 1), rows)
    return {
        **{name: measured[name] for name in ("door", "policy", *NUMBERS)},
        "seed": task.seed,
        "why": why_closed(log.failure, log.reason),
        "film": f"{name}.mp4",
        "pictures": pictures,
        "angle": np.degrees(log.door_angle[rows]).round(1).tolist(),
        "radial": np.maximum.reduceat(abs(log.force_radial), since).round(1).tolist(),
    }


def _read(folder: Path) -> tuple[list[dict[str, Any]], dict[str, dict[str, Any]]]:
    """Return the origin of a gallery's episodes, and episodes with a video by task."""
    file = folder / DATA
    if not file.exists():
        if (folder / PAGE).exists():
            raise ValueError(f"{folder} has another {PAGE}; give another --out")
        return [], {}
    with naming(file):
        text = file.read_text(encoding="utf-8").strip()
        data = parsed_json(text.removeprefix(_ASSIGNED).removesuffix(";"))
        check_stamp(data, *_STAMP.values())
        made = entry(data, "made", tuple[dict[str, Any], ...])
        episodes = entry(data, "episodes", tuple[dict[str, Any], ...])
        films = {entry(one, "task", str): entry(one, "film", str) for one in episodes}
    there = [one for one in episodes if (folder / films[one["task"]]).is_file()]
    return [*made], {one["task"]: one for one in there}


def _write(
    folder: Path,
    made: Sequence[Mapping[str, Any]],
    known: Mapping[str, Any],
    asked: Sequence[str],
) -> None:
    """Write page and data; the requested episodes come last, in their order."""
    order = [key for key in known if key not in asked]
    order += [key for key in asked if key in known]
    data = {**_STAMP, "made": made, "episodes": [known[key] for key in order]}
    text = json_text(data, indent=None).replace("}, {", "},\n{")
    page = files(__package__).joinpath("gallery.html").read_text(encoding="utf-8")
    for name, content in {DATA: f"{_ASSIGNED}{text};\n", PAGE: page}.items():
        with complete_or_absent(folder / name) as temporary:
            temporary.write_text(content, encoding="utf-8")
