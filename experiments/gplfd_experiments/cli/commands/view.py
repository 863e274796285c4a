"""``gplfd view``: open a recording in the Rerun viewer, or watch an episode live."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from gplfd_experiments.console.interruption import postponed_interruption


@dataclass(frozen=True, kw_only=True, slots=True)
class View:
    """Open a recording (.rrd) in the Rerun viewer, or watch an episode live."""

    file: Annotated[
        tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="[FILE.rrd]")
    ] = None
    """Recording to open, for example results/gp-seed0/medium.rrd."""

    live: bool = False
    """Instead of opening a recording, run an episode and watch it."""

    door: str = "medium"
    """With --live: the door to open, a name (see `gplfd list`), a radius [m], or
    a .json file of door parameters."""

    policy: str = "gp"
    """With --live: the policy to use; see `gplfd list`."""

    seed: int = 0
    """With --live: seed of teacher, policy and environment, 0 or more."""

    randomization: str = "none"
    """With --live: what is drawn at random: none, mild, hard or standard."""

    disturbance: str = "none"
    """With --live: disturbance during the episode: none, push, person, ..."""

    start: Literal["grasped", "approach"] = "grasped"
    """With --live: what the episode begins with, the handle in the hand or the open
    hand before it."""

    speed: float = 1.0
    """With --live: simulated seconds per second."""

    serve: bool = False
    """With --live: serve the viewer to a browser on this machine instead of opening a
    window."""

    def execute(self) -> int:
        """Show the recording or the episode until the viewer is closed."""
        if not self.live:
            with postponed_interruption():
                from gplfd_experiments.recording.viewer import open_recording

            return open_recording(self._recording())
        with postponed_interruption():
            from gplfd_experiments.console.arguments import check_circumstances
            from gplfd_experiments.recording.live import watch

        if self.file is not None:
            raise ValueError(f"--live runs an episode; it does not go with {self.file}")
        check_circumstances(self.randomization, self.disturbance)
        watch(
            self.door,
            policy=self.policy,
            seed=self.seed,
            randomization=self.randomization,
            disturbance=self.disturbance,
            start=self.start,
            speed=self.speed,
            serve=self.serve,
        )
        return 0

    def _recording(self) -> Path:
        """Return the recording to open.

        Raises:
            ValueError: There is none, or options are for --live.
        """
        if self.file is None:
            raise ValueError(
                "give a recording to open, for example results/gp-seed0/medium.rrd, or "
                "--live to run an episode and watch it"
            )
        for option in dataclasses.fields(self):
            given = getattr(self, option.name)
            if option.name != "file" and given != option.default:
                raise ValueError(f"--{option.name} goes with --live, not with a file")
        return self.file
