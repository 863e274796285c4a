"""The command export: a skill in files that robots read."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, get_args

import tyro

from gplfd_experiments.cli.commands.options import Quiet, numbers
from gplfd_experiments.console.interruption import postponed_interruption

FormName = Literal["csv", "tum", "bag", "json"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Export:
    """Write poses, σ, stiffness and damping of a skill for a robot.

    The stiffness is governed, so that it is stable, and the motion runs by the clock:
    what the robot measures changes nothing. CSV, TUM trajectory, JSON, and a ROS 2 bag
    with the topics that crisp_controllers reads (pip install 'gplfd[ros]'). Nothing of
    it was tried on hardware: read docs/skill-to-robot.md first.
    """

    skill: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="SKILL")]
    """Skill to export, a file written by `gplfd learn`."""

    out: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="FILE")] = ()
    """Files to write, SKILL.json by default: their suffixes .csv, .tum, .json and .bag
    (a folder) are their forms. What is there already is replaced."""

    form: tuple[FormName, ...] = ()
    """Forms to write, all with the name of the one --out."""

    rate: Annotated[float, tyro.conf.arg(metavar="HZ")] = 100.0
    """Samples per second, 20 to 1000. The simulation has 100."""

    frame: Annotated[str | None, tyro.conf.arg(metavar="POSE")] = None
    """Pose of the task frame in the frame of the robot's base, x,y,z,qw,qx,qy,qz [m];
    with = if x is negative: --frame=-0.5,... Without it all is in the task frame."""

    tool: Annotated[str | None, tyro.conf.arg(metavar="QUATERNION")] = None
    """With --frame: orientation qw,qx,qy,qz of the robot's tool frame at the closed
    door, in the task frame."""

    policy: str = "gp"
    """Policy by whose stiffness law the skill is followed, the one that learned it."""

    quiet: Quiet = False

    def execute(self) -> int:
        """Write the files and say what is in them."""
        with postponed_interruption():
            from gplfd_experiments.workflows.exports import export_skill

        outs = self.out or (Path(self.skill.stem),)
        forms = self.form or (() if self.out else ("json",))
        if forms and len(outs) > 1:
            raise ValueError("--form goes with one --out; or give each its suffix")
        if forms:
            (out,) = outs
            known = out.suffix[1:] in get_args(FormName)
            stem = out.with_suffix("") if known else out
            outs = tuple(stem.with_name(f"{stem.name}.{form}") for form in forms)
        posed, turned = "x,y,z,qw,qx,qy,qz", "qw,qx,qy,qz"
        frame, tool = self.frame, self.tool
        commands = export_skill(
            self.skill,
            outs,
            policy=self.policy,
            rate=self.rate,
            frame=None if frame is None else numbers("--frame", frame, posed),
            tool=None if tool is None else numbers("--tool", tool, turned),
        )
        path, demonstrated = commands.path, commands.about["demonstrated_until_s"]
        lowest, highest = path.stiffness.min(axis=0), path.stiffness.max(axis=0)
        print(f"{', '.join(map(str, outs))}: {len(path.times)} samples")
        print(f"frame: {commands.axes}")
        print(
            f"{path.times[-1]:.2f} s, demonstrated until {demonstrated:.2f} s; "
            f"stiffness {lowest[:3].min():.0f} to {highest[:3].max():.0f} N/m and "
            f"{lowest[3:].min():.0f} to {highest[3:].max():.0f} N m/rad, stable for "
            f"{path.dynamics.mass[0]:g} kg and {path.dynamics.mass[3]:g} kg m²"
        )
        return 0
