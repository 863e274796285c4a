"""``gplfd run``: demonstrations, skill, and every door opened once."""

import contextlib
import ctypes.util
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal

import tyro

from gplfd_experiments.cli.commands.options import Json, Quiet, next_command, recorded
from gplfd_experiments.console.interruption import postponed_interruption

FAILED: Final = 1
"""Exit status of a run in which the policy raised an error."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Run:
    """Learn from demonstrations, open doors, and keep numbers and recordings.

    Writes DIR/metrics.json (one object per door), DIR/<door>.rrd (Rerun recording),
    DIR/<door>.npz (everything that was logged), DIR/demonstrations.npz and
    DIR/run.json (versions, command, settings); removes what an earlier run wrote there.
    """

    doors: tuple[str, ...] = ("small", "medium", "large")
    """Doors to open: names (see `gplfd list`), radii in metres, or .json files of door
    parameters."""

    policy: str = "gp"
    """Policy to use: a name from `gplfd list`, or module:function for one of your
    own."""

    seed: int = 0
    """Seed of teacher, policy and environment, 0 or more."""

    randomization: str = "none"
    """What is drawn at random for each episode: none, mild, hard or standard; see
    `gplfd list`."""

    disturbance: str = "none"
    """Disturbance during the episode: none, push, person, ...; see `gplfd list`."""

    start: Literal["grasped", "approach"] = "grasped"
    """State at the start: the hand holds the handle, or the open hand is 10 to 20 cm
    in front of it and first reaches for it."""

    demonstrations_per_door: int = 2
    """Number of demonstrations by the synthetic human on each of the three
    demonstrated doors."""

    demonstrations: Annotated[Path | None, tyro.conf.arg(metavar="FILE.npz")] = None
    """Learn from this .npz file of demonstrations instead of the synthetic human."""

    skill: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Use this skill, a file written by `gplfd learn`, instead of learning one."""

    looks: Literal["primitives", "tiago"] = "primitives"
    """Shapes of the robot in recordings: simple ones, or the manufacturer's meshes of
    the package example-robot-data (pip install 'gplfd[tiago]')."""

    video: Annotated[Path | None, tyro.conf.arg(metavar="FILE.mp4")] = None
    """Write a video of the episode, too, in real time; of several doors one each,
    FILE-DOOR.mp4: pip install 'gplfd[video]'."""

    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder to write to; results/POLICY-seedSEED by default."""

    json: Json = False

    quiet: Quiet = False

    def execute(self) -> int:
        """Open the doors and print a table, or what metrics.json holds.

        Returns:
            0, or `FAILED` if the policy raised an error.
        """
        if self.video is not None:
            _draw_without_screen()
        with postponed_interruption():
            from gplfd_experiments.analysis.results.table import run_table
            from gplfd_experiments.console.progress import LOG
            from gplfd_experiments.episodes.metrics import late_decisions
            from gplfd_experiments.files.names import file_name
            from gplfd_experiments.files.plain_data import json_text
            from gplfd_experiments.files.table import text_table
            from gplfd_experiments.workflows.runs import open_doors

        if self.skill is not None and self.demonstrations is not None:
            raise ValueError("--skill is learned already: leave out --demonstrations")
        folder = (
            self.out or Path("results") / f"{file_name(self.policy)}-seed{self.seed}"
        )
        # What a policy prints is no part of the table or JSON on standard output.
        with contextlib.redirect_stdout(sys.stderr):
            metrics = open_doors(
                self.doors,
                folder,
                policy=self.policy,
                seed=self.seed,
                demonstrations=self.demonstrations or self.demonstrations_per_door,
                skill=self.skill,
                randomization=self.randomization,
                disturbance=self.disturbance,
                start=self.start,
                looks=self.looks,
                options=recorded(self),
                video=self.video,
            )
        numbers = [one.as_json() for one in metrics]
        if late := late_decisions(numbers):
            LOG.warning("warning: %s: %s", self.policy, late)
        status = FAILED if any("error" in one for one in numbers) else 0
        if self.json:
            print(json_text(numbers))
            return status
        print(text_table(run_table(metrics)))
        doors = [one["door"] for one in numbers if "error" not in one]
        if doors:
            shown = "medium" if "medium" in doors else doors[0]
            print(f"\nlook at it:  {next_command('view', folder / f'{shown}.rrd')}")
        return status


def _draw_without_screen() -> None:
    """Let MuJoCo draw by EGL where there is no screen; call before MuJoCo's import.

    What the user has set stays. Where EGL is missing, drawing says what to install.
    """
    screen = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if (
        sys.platform.startswith("linux")
        and not screen
        and ctypes.util.find_library("EGL")
    ):
        os.environ.setdefault("MUJOCO_GL", "egl")
