"""The command that serves an agent to a robot."""

import dataclasses
from dataclasses import dataclass

import tyro

from gplfd_policies.serving.settings import ServeSettings


@dataclass(frozen=True, kw_only=True, slots=True)
class Serve(ServeSettings):
    """Serve an agent to a robot: observations in, commands out, line by line.

    The protocol, its states and its limits are in docs/serving.md. The process never
    loads MuJoCo. By default, a policy learns from the synthetic human's demonstrations
    of doors with a bar.
    """

    source: tyro.conf.Positional[str] = dataclasses.field(
        metadata={"help": "Skill file (.npz of `gplfd learn`), or name of a policy."}
    )

    def execute(self) -> int:
        """Serve until the client or Ctrl-C ends it."""
        from gplfd_experiments.data.teacher import Teacher
        from gplfd_experiments.data.teacher.handle_motion import with_reaches
        from gplfd_policies.demonstrations.npz import LabelledDemonstrations
        from gplfd_policies.serving.server import serve

        demonstrations = None
        if self.demonstrations is None and not self.source.endswith(".npz"):
            teacher = Teacher()
            openings = teacher.standard_demonstrations(seed=self.seed)
            radii = (None,) * len(openings)
            demonstrations = LabelledDemonstrations(
                demonstrations=openings, radii=radii
            )
            if self.start == "approach":
                reaches = teacher.standard_reaches(seed=self.seed)
                demonstrations = with_reaches(reaches, openings, radii)
        serve(self, demonstrations)
        return 0
