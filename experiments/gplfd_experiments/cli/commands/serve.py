"""The command that serves an agent to a robot."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from gplfd_policies.serving.settings import ServeSettings


def _same(name: str) -> Any:
    """Declare a field of `ServeSettings`; the annotation adds the help of tyro."""
    (field,) = (one for one in dataclasses.fields(ServeSettings) if one.name == name)
    return dataclasses.field(default=field.default, metadata=field.metadata)


@dataclass(frozen=True, kw_only=True, slots=True)
class Serve(ServeSettings):
    """Serve an agent to a robot: observations in, commands out, line by line.

    The protocol, its states and its limits are in docs/serving.md. The process never
    loads MuJoCo. By default, a policy learns from the synthetic human's demonstrations
    of doors with a bar.
    """

    source: Annotated[
        str, tyro.conf.Positional, tyro.conf.arg(metavar="SKILL.npz|POLICY")
    ] = _same("source")
    demonstrations: Annotated[Path | None, tyro.conf.arg(metavar="FILE.npz")] = _same(
        "demonstrations"
    )
    socket: Annotated[Path | None, tyro.conf.arg(metavar="PATH")] = _same("socket")
    port: Annotated[int | None, tyro.conf.arg(metavar="PORT")] = _same("port")
    journal: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = _same("journal")

    def execute(self) -> int:
        """Serve until the client or Ctrl-C ends it."""
        from gplfd_experiments.data.teacher import Teacher
        from gplfd_experiments.data.teacher.reaching import with_reaches
        from gplfd_policies.demonstrations.npz import LabelledDemonstrations
        from gplfd_policies.serving.server import serve

        given = None
        if self.demonstrations is None and not self.source.endswith(".npz"):
            teacher = Teacher()
            shown = teacher.standard_demonstrations(seed=self.seed)
            radii = (None,) * len(shown)
            given = LabelledDemonstrations(demonstrations=shown, radii=radii)
            if self.start == "approach":
                reaches = teacher.standard_reaches(seed=self.seed)
                given = with_reaches(reaches, shown, radii)
        serve(self, given)
        return 0
