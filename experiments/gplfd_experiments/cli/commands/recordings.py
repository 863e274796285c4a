"""``gplfd demos import`` and ``export``: demonstrations from and for others."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from gplfd_experiments.cli.commands.options import Quiet, next_command, recorded
from gplfd_experiments.console.interruption import postponed_interruption


@dataclass(frozen=True, kw_only=True, slots=True)
class Import:
    """Make a set of demonstrations of recorded motions, and say what was done.

    Read are CSV and TSV, .npz and .npy, MATLAB's .mat, Xsens' .mvnx, .bvh, .c3d, bags
    of ROS (.mcap, .db3, .bag, folders), LeRobot v3, robomimic's .hdf5, and data sets of
    `gplfd demos record`. SET holds demonstrations.npz, a report, a picture of before
    and after, and where all came from. Lines of the report with ! need attention.
    See docs/recordings.md.
    """

    files: Annotated[
        tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FILES")
    ]
    """Recordings: files, or folders of those kinds that are folders."""

    out: Annotated[Path, tyro.conf.arg(metavar="SET")]
    """Folder to write."""

    body: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """What moves: a segment, joint, marker or three, topic, array, or arrays A,B."""

    columns: Annotated[str | None, tyro.conf.arg(metavar="t,x,y,z,...")] = None
    """Names of the columns of a table without a header, in order, with - for one to
    leave out; known are t, x, y, z, qw, qx, qy, qz, rx, ry, rz, fx, ..., gripper."""

    units: Literal["m", "cm", "mm", "in"] | None = None
    """Unit of positions; before what the file says, and metres where it says none."""

    time_unit: Literal["s", "ms", "us", "ns"] | None = None
    """Unit of times in tables and arrays; before what the file says, and seconds where
    it says none."""

    angles: Literal["rad", "deg"] = "rad"
    """Unit of rotation vectors rx, ry, rz that say none."""

    quaternions: Literal["wxyz", "xyzw"] | None = None
    """Order of quaternions whose components have no names."""

    recorded_rate: Annotated[float | None, tyro.conf.arg(metavar="HZ")] = None
    """Samples per second of recordings without time stamps."""

    urdf: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Robot whose joint states were recorded."""

    link: str | None = None
    """Link of that robot which is the hand."""

    frame: Annotated[str, tyro.conf.arg(metavar="FRAME")] = "first-pose"
    """What poses are relative to: first-pose (each its own), recorded, hinge (of a
    door, found from the motion), or a pose x,y,z,qw,qx,qy,qz [m]."""

    offset: Annotated[str | None, tyro.conf.arg(metavar="POSE")] = None
    """Pose of the object in the frame of the recorded hand, x,y,z,qw,qx,qy,qz [m]."""

    segment: Annotated[str, tyro.conf.arg(metavar="HOW")] = "none"
    """Repetitions in a recording: none, rests or turns (what lies between them, without
    motions back), or times since the first sample such as 1.5-4.2,6-9.5 [s]."""

    keep_rests: tyro.conf.FlagCreatePairsOff[bool] = False
    """Keep rests at both ends."""

    cutoff: Annotated[float, tyro.conf.arg(metavar="HZ")] = 10.0
    """Cut-off of the low-pass filter; 0 for none."""

    rate: Annotated[float, tyro.conf.arg(metavar="HZ")] = 100.0
    """Samples per second of the result; 0 for the samples as recorded."""

    largest_gap: Annotated[float, tyro.conf.arg(metavar="S")] = 0.5
    """Longest time without a sample that is bridged [s]."""

    overwrite: tyro.conf.FlagCreatePairsOff[bool] = False
    """Replace the set that is there already."""

    quiet: Quiet = False

    def execute(self) -> int:
        """Make the set, print the report and what to do next."""
        with postponed_interruption():
            from gplfd_experiments.data.importing import PICTURE, import_recordings
            from gplfd_experiments.data.readers.selection import Selection

        if not self.files:
            raise ValueError("give at least one file to import")
        selection = Selection(
            body=self.body,
            columns=_names(self.columns),
            units=self.units,
            time_unit=self.time_unit,
            angles=self.angles,
            quaternions=self.quaternions,
            recorded_rate=self.recorded_rate,
            urdf=self.urdf,
            link=self.link,
        )
        options = recorded(self)
        options["files"] = [file.name for file in self.files]
        options["out"] = self.out.name
        options["urdf"] = self.urdf.name if self.urdf else None
        done = import_recordings(
            self.files,
            self.out,
            selection=selection,
            preparation=self._preparation(),
            options=options,
            overwrite=self.overwrite,
        )
        print(done.report)
        number = len(done.motions)
        print(f"\n{number} demonstration{'s' * (number > 1)} in {self.out}")
        if done.warnings:
            print(f"notes marked with ! that need attention: {done.warnings}")
        print(f"look at them:     {self.out / PICTURE}")
        out = self.out.with_name(f"{self.out.name}-skill.npz")
        print(f"learn from them:  {next_command('learn', self.out, '--out', out)}")
        return 0

    def _preparation(self) -> Any:
        from gplfd_experiments.data.preparation.settings import Preparation

        frame = _pose("--frame", self.frame) if "," in self.frame else self.frame
        return Preparation(
            units=self.units,
            frame=frame,  # type: ignore[arg-type]
            offset=None if self.offset is None else _pose("--offset", self.offset),
            segments=_segments(self.segment),
            trim_rests=not self.keep_rests,
            cutoff=self.cutoff or None,
            rate=self.rate or None,
            largest_gap=self.largest_gap,
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class Export:
    """Write demonstrations or episodes in the form of another program.

    robomimic's is one .hdf5 file, LeRobot's (version 3) a folder. An action is the pose
    at the next sample; in episodes, the last that was commanded before it.
    """

    demonstrations: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="SET")]
    """Folder of `gplfd demos import`, or a demonstrations.npz; or episodes, the folder
    of `gplfd demos record`."""

    out: Annotated[Path, tyro.conf.arg(metavar="PATH")]
    """File or folder to write."""

    form: Literal["robomimic", "lerobot"]
    """Whose form."""

    pictures: tuple[str, ...] = ()
    """Cameras whose pictures of episodes are written, in LeRobot's form: overview, top,
    head, hand_camera."""

    size: Annotated[tuple[int, int], tyro.conf.arg(metavar="W H")] = (320, 240)
    """Width and height of the pictures [px]."""

    rate: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Rows per second of episodes; 100 by default, 10 with pictures."""

    def execute(self) -> int:
        """Write it, and say where it is."""
        with postponed_interruption():
            from gplfd_experiments.data.writers import export_demonstrations

        number = export_demonstrations(
            self.demonstrations,
            self.out,
            self.form,
            rate=self.rate,
            cameras=self.pictures,
            size=self.size,
        )
        print(f"{number} demonstration{'s' * (number > 1)} in {self.out}")
        return 0


def _names(columns: str | None) -> tuple[str, ...]:
    if columns is None:
        return ()
    return tuple(name.strip() for name in columns.split(","))


def _pose(option: str, text: str) -> Any:
    """Return seven numbers."""
    try:
        numbers = tuple(map(float, text.split(",")))
    except ValueError:
        numbers = ()
    if len(numbers) != 7:
        raise ValueError(f"{option} {text!r} must be seven numbers x,y,z,qw,qx,qy,qz")
    return numbers


def _segments(text: str) -> Any:
    """Return times of repetitions, or the word that says how they are found."""
    if "-" not in text:
        return text
    try:
        parts = [part.split("-") for part in text.split(",")]
        return tuple((float(start), float(end)) for start, end in parts)
    except ValueError:
        raise ValueError(
            f"--segment {text!r} must be none, rests, turns, or times such as "
            "1.5-4.2,6-9.5"
        ) from None
