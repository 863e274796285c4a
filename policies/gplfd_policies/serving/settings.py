"""Settings of a served agent: agent, address, watchdog and operator limits.

Its fields are the options of `gplfd serve` and of ``python -m gplfd_policies.serving``.
"""

import dataclasses
import ipaddress
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

Pair = tuple[float, float]
Box = tuple[float, float, float, float, float, float]


def _option(default: Any, text: str, **allowed: Any) -> Any:
    """Declare an option with its help; for a number, with `low` or `above`."""
    return dataclasses.field(default=default, metadata={**allowed, "help": text})


@dataclass(frozen=True, kw_only=True, slots=True)
class OperatorLimits:
    """Limits of an operator, which act on what is served and exported."""

    workspace: Box = _option(
        (-2.0, -2.0, -2.0, 2.0, 2.0, 2.0),
        "Least x y z and greatest x y z of the hand in the task frame [m].",
    )
    linear_speed: float = _option(2.0, "Greatest speed [m/s].", above=0.0)
    angular_speed: float = _option(10.0, "Greatest speed [rad/s].", above=0.0)
    force: float = _option(
        200.0, "Greatest measured force [N]; of an export, in its dry run.", above=0.0
    )
    moment: float = _option(50.0, "The same of the moment [N m].", above=0.0)
    least_stiffness: Pair = _option(
        (100.0, 10.0), "Least stiffness [N/m, N m/rad]; a stop softens to it."
    )
    greatest_stiffness: Pair = _option(
        (2000.0, 500.0), "Greatest stiffness [N/m, N m/rad]."
    )

    def __post_init__(self) -> None:
        # Not by `gplfd_env.validation`: NumPy would make every --help slow.
        for field in dataclasses.fields(self):
            value, bounds = getattr(self, field.name), field.metadata
            low, above = bounds.get("low", -math.inf), bounds.get("above", -math.inf)
            limited = bounds.keys() > {"help"}
            if limited and not (low <= value < math.inf and value > above):
                least = f"{low} or more" if "low" in bounds else f"greater than {above}"
                flag = field.name.replace("_", "-")
                raise ValueError(f"--{flag} {value} must be finite and {least}")
        ends = zip(self.workspace[:3], self.workspace[3:], strict=True)
        if not all(-math.inf < low < high < math.inf for low, high in ends):
            raise ValueError(
                f"--workspace {self.workspace} must be least x y z and then greatest "
                "x y z [m], all finite, each least below its greatest"
            )
        pairs = zip(self.least_stiffness, self.greatest_stiffness, strict=True)
        if not all(0.0 < low <= high < math.inf for low, high in pairs):
            raise ValueError(
                f"--least-stiffness {self.least_stiffness} must be positive and not "
                f"above --greatest-stiffness {self.greatest_stiffness}, which is finite"
            )


@dataclass(frozen=True, kw_only=True, slots=True)
class ServeSettings(OperatorLimits):
    """Served agent, address and limits; checked on creation."""

    source: str = dataclasses.field(
        metadata={"help": "Skill file (.npz of `gplfd learn`), or name of a policy."}
    )
    policy: str = _option("gp", "For a skill file: the policy whose agent follows it.")
    demonstrations: Path | None = _option(
        None, "For a policy that learns: .npz file of the demonstrations."
    )
    start: Literal["grasped", "approach"] = _option(
        "grasped",
        "Start of an episode: the hand holds the handle, or the open hand is in front "
        "of it (demonstrations must then have the signal 'grasped').",
    )
    seed: int = _option(0, "Seed for random numbers in learning.", low=0)
    socket: Path | None = _option(
        None, "Listen on this Unix socket, mode 0600, instead of standard input."
    )
    port: int | None = _option(None, "Listen on this TCP port instead; 0 for any free.")
    protocol: Literal["lines", "openpi"] = _option(
        "lines",
        "Lines of JSON (docs/robot.md), or openpi: a WebSocket on --port (8000 "
        "unless given), MessagePack with arrays; pip install 'gplfd[remote]'.",
    )
    host: str = _option("127.0.0.1", "Address of the TCP port.")
    beyond_loopback: bool = _option(
        False,
        "Allow a --host that other machines reach. There is no encryption and no "
        "password: whoever reaches the port commands the robot.",
    )
    journal: Path | None = _option(None, "Append all messages to this file.")
    hold_after: float = _option(
        0.05, "Hold after this time without a valid observation [s].", low=0.02
    )
    stop_after: float = _option(
        0.5, "Soften and stop after this time without valid observation [s].", low=0.02
    )
    soften_time: float = _option(0.5, "Duration of softening [s].", above=0.0)
    follow_distance: float = _option(
        0.5, "Greatest distance of the hand from its command [m].", above=0.0
    )
    follow_angle: float = _option(
        1.5, "Greatest rotation between hand and command [rad].", above=0.0
    )
    follow_time: float = _option(
        0.2, "Time for which the hand may be farther away [s].", low=0.0
    )

    def __post_init__(self) -> None:
        OperatorLimits.__post_init__(self)
        if self.start not in ("grasped", "approach"):
            raise ValueError(f"--start {self.start} must be grasped or approach")
        if self.stop_after < self.hold_after:
            raise ValueError(
                f"--stop-after {self.stop_after} must not be less than --hold-after "
                f"{self.hold_after} [s]"
            )
        if self.socket is not None and self.port is not None:
            raise ValueError("give --socket or --port, not both")
        if self.protocol not in ("lines", "openpi"):
            raise ValueError(f"--protocol {self.protocol} must be lines or openpi")
        if self.protocol == "openpi" and self.socket is not None:
            raise ValueError("--protocol openpi needs --port, and no --socket")
        if self.protocol == "openpi" and self.port is None:
            object.__setattr__(self, "port", 8000)
        if self.port is not None and not 0 <= self.port < 65536:
            raise ValueError(f"--port {self.port} must be from 0 to 65535")
        if self.host == "localhost":
            object.__setattr__(self, "host", "127.0.0.1")
        try:
            here = ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            here = False
        if not (self.beyond_loopback or here):
            raise ValueError(
                f"--host {self.host} may be reached from other machines, without "
                "password or encryption; give --host 127.0.0.1, or add "
                "--beyond-loopback if that is what you want"
            )

    def described(self) -> dict[str, Any]:
        """Return all settings as JSON-compatible values."""
        settings = dataclasses.asdict(self).items()
        return {k: str(v) if isinstance(v, Path) else v for k, v in settings}


LIMITS: Final = (
    *(field.name for field in dataclasses.fields(OperatorLimits)),
    *("follow_distance", "follow_angle", "follow_time"),
)
"""Fields that limit the robot."""

WATCHDOG: Final = ("hold_after", "stop_after", "soften_time")  # Fields of the watchdog.
