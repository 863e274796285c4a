"""Commands for a robot: export, which writes a skill in file formats, and serve."""

import dataclasses
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from gplfd_experiments.data.settings import POSE, numbers, of_text
from gplfd_policies.serving.settings import OperatorLimits, ServeSettings


@dataclass(frozen=True, kw_only=True, slots=True)
class Export(OperatorLimits):
    """Write poses, σ, stiffness and damping of a skill for a robot.

    The stiffness is stable. The motion runs by the clock and does not react to
    measurements of the robot. Formats: CSV, TUM trajectory, JSON, and a ROS 2 bag with
    the topics that crisp_controllers reads (pip install 'gplfd[ros]'). A motion beyond
    the limits of the operator or of the robot is not written, with exit status 1. This
    was not tried on hardware: read docs/robot.md first.
    """

    skill: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="SKILL")]
    """Skill to export, a file written by `gplfd learn`."""

    out: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="FILE")]
    """Files to write; the suffixes .csv, .tum, .json and .bag (a folder) select the
    format. Existing files are replaced."""

    form: tuple[Literal["csv", "tum", "bag", "json"], ...] = ()
    """Formats to write; --out is then given without a suffix."""

    rate: Annotated[float, tyro.conf.arg(metavar="HZ")] = 100.0
    """Samples per second, 20 to 1000. The simulation uses 100."""

    frame: Annotated[tuple[float, ...] | None, of_text("POSE", numbers(POSE))] = None
    """Pose of the task frame in the frame of the robot's base, x,y,z,qw,qx,qy,qz [m];
    with = if x is negative: --frame=-0.5,... Default: poses in the task frame."""

    tool: Annotated[
        tuple[float, ...] | None, of_text("QUATERNION", numbers("qw,qx,qy,qz"))
    ] = None
    """With --frame: orientation qw,qx,qy,qz of the robot's tool frame at the closed
    door, in the task frame."""

    policy: str = "gp"
    """Policy whose stiffness law is used; the policy that learned the skill."""

    robot: Annotated[str | None, tyro.conf.arg(metavar="ROBOT")] = None
    """Also simulate the motion with this robot, placed by --frame; print the expected
    force, speed, stiffness and joint margins: tiago-like, panda-like, ur5e-like, a
    .urdf, or a .json with the arguments of gplfd_env.robot.urdf.robot_of_urdf."""

    door: str = "medium"
    """With --robot: a door's name (see `gplfd list`), radius [m], or .json file."""

    allow: bool = False
    """Write the files although limits are exceeded."""

    def execute(self) -> int:
        """Write the files and print their contents."""
        from gplfd_experiments.workflows import exports

        outs = [Path(f"{out}.{form}") for out in self.out for form in self.form]
        outs = outs or list(self.out)
        for name, value in (("frame", self.frame), ("tool", self.tool)):
            if isinstance(value, str):
                raise ValueError(f"--{name} {value!r} must be numbers, see --help")
        if self.robot is None and self.door != "medium":
            raise ValueError("--door goes with --robot, the robot of the dry run")
        exceeded: Sequence[str] = ()
        if self.robot is not None:
            place = self.robot, self.door, self.frame, self
            summary, _, exceeded = exports.dry_run(self.skill, self.policy, *place)
            print("\n".join(f"{name}: {value}" for name, value in summary.items()))
        try:
            path, about = exports.export_skill(
                *(self.skill, outs, self.policy, self.rate, self.frame, self.tool),
                limits=self,
                exceeded=exceeded,
                allow=self.allow,
            )
        except exports.LimitsExceededError as error:
            for sentence in error.args:
                print(f"gplfd: {sentence}", file=sys.stderr)
            print("gplfd: nothing is written; --allow writes it", file=sys.stderr)
            return 1
        print(
            f"{', '.join(map(str, outs))}: {len(path.times)} samples in the frame of "
            f"the {about['frame']['name']}, {path.times[-1]:.2f} s, demonstrated until "
            f"{about['demonstrated_until_s']:.2f} s, stiffness up to "
            f"{path.stiffness[:, :3].max():.0f} N/m"
        )
        return 0


@dataclass(frozen=True, kw_only=True, slots=True)
class Serve(ServeSettings):
    """Serve an agent to a robot: observations in, commands out, line by line.

    The protocol, its states and its limits are in docs/robot.md. The process never
    loads MuJoCo. By default, a policy learns from synthetic demonstrations of bars.
    """

    source: tyro.conf.Positional[str] = dataclasses.field(
        metadata={"help": "Skill file (.npz of `gplfd learn`), or name of a policy."}
    )

    def execute(self) -> int:
        """Serve until the client or Ctrl-C ends it."""
        from gplfd_experiments.data.teacher import Teacher
        from gplfd_experiments.data.teacher.motion import with_reaches
        from gplfd_policies.demonstrations.npz import LabelledDemonstrations
        from gplfd_policies.serving.server import serve

        labelled = None
        if self.demonstrations is None and not self.source.endswith(".npz"):
            teacher = Teacher()
            openings = teacher.standard_demonstrations(seed=self.seed)
            radii = (None,) * len(openings)
            labelled = LabelledDemonstrations(demonstrations=openings, radii=radii)
            if self.start == "approach":
                reaches = teacher.standard_reaches(seed=self.seed)
                labelled = with_reaches(reaches, openings, radii)
        serve(self, labelled)
        return 0
