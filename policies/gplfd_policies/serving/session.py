"""State of a served agent: checks of messages, watchdog, limits and commands.

There is no input or output; time is an argument. docs/robot.md defines the states.
"""

import math
from typing import Final, Literal

import numpy as np

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.spatial.se3 import compose_rotvecs, rotation_distance
from gplfd_policies.agents.agent import Agent
from gplfd_policies.control.steps import STEP_SHAPES, AgentStep
from gplfd_policies.control.stiffness import DEFAULT_DYNAMICS, DEFAULT_PROFILE
from gplfd_policies.demonstrations.npz import FRAME
from gplfd_policies.serving.protocol import (
    MOST_TURNED,
    UNITS,
    VERSION,
    Message,
    Observed,
    ProtocolError,
    decode,
    numbers,
    observed,
)
from gplfd_policies.serving.settings import LIMITS, WATCHDOG, ServeSettings

HEARTBEAT: Final = 0.25
"""Longest silence of the server while a client is connected [s]."""

_DRIFT: Final = 1e-3  # greatest relative drift of the two clocks [s/s]
_BURST: Final = 1.5  # periods by which an observation may be early, because of jitter


class Session:
    """Successive connections to one agent.

    Args:
        agent: Agent that acts once per control period of the robot's clock.
        settings: Watchdog and limits.
        address: Address of clients, for the greeting.
    """

    def __init__(self, agent: Agent, settings: ServeSettings, address: str) -> None:
        self._agent, self._settings = agent, settings
        self._control, self._dynamics = agent.control, agent.dynamics
        self.patience = settings.stop_after
        """Time of silence after which a client makes room for another [s]."""
        self._softest = np.repeat(settings.least_stiffness, 3)
        described = settings.described()
        self.greeting: Message = {
            "type": "hello",
            "protocol": VERSION,
            "control": self._control,
            "period": CONTROL_PERIOD,
            "source": settings.source,
            "frame": FRAME,
            "units": UNITS,
            "limits": {name: described[name] for name in LIMITS},
            "watchdog": {name: described[name] for name in WATCHDOG},
            "heartbeat": HEARTBEAT,
            "address": address,
            "beyond_loopback": settings.beyond_loopback,
        }
        self.connect(0.0)

    def connect(self, now: float) -> None:
        """Begin with a new client; also ends the last session."""
        self.state: Literal["idle", "active", "holding", "stopped"] = "idle"
        self.reason = ""
        self.greeted = self.closed = self._explain = False
        self._soft = False  # whether a stop has softened the arm
        self._spoke = self._commanded = now  # last message, last command
        self._most_turned = MOST_TURNED

    @property
    def due(self) -> float:
        """Time of the next message of `tick`, unless a message arrives before [s]."""
        if self.state in ("holding", "stopped") and not self._soft:
            return self._commanded + CONTROL_PERIOD
        beat = self._spoke + HEARTBEAT if self.greeted else math.inf
        if self.state == "active":
            beat = min(beat, self._heard + self._settings.hold_after)
        return beat

    def receive(self, line: bytes, now: float) -> tuple[bytes | str, list[Message]]:
        """Return a line that arrived now [s], and the replies to it.

        A line that is no message is returned as text; it is not heard from the client.
        """
        replies = self.tick(now)  # it may have come too late
        try:
            message = decode(line)
        except ProtocolError as error:
            return line.decode(errors="replace"), [*replies, error.reply]
        try:
            replies.append(self._reply(message, now))
        except ProtocolError as error:
            replies.append(error.reply)
        self._spoke = now
        return line, replies

    def tick(self, now: float) -> list[Message]:
        """Return unsolicited messages due now [s]: holding, softening, heartbeat.

        Only an accepted observation puts off the watchdog, and only a command the next
        command of holding or softening.
        """
        settings = self._settings
        if self.state in ("active", "holding"):
            # The same sums as in `due`: differences would round differently.
            if now >= self._heard + settings.stop_after:
                self._stop("no valid observation", now)
            elif now >= self._heard + settings.hold_after:
                self.state, self.reason = "holding", "no valid observation"
        if now < self.due:
            return []
        self._spoke = now
        if self.state in ("holding", "stopped") and not self._soft:
            return [{**self._command(now), "unsolicited": True}]
        return [self._heartbeat()]

    def _heartbeat(self) -> Message:
        return {"type": "heartbeat", "state": self.state, "reason": self.reason}

    def _reply(self, message: Message, now: float) -> Message:
        kind = message["type"]
        if kind == "hello":
            if message.get("protocol") != VERSION:
                self.closed = True
                raise ProtocolError(
                    "version",
                    f"this server speaks protocol {VERSION}, the client "
                    f"{message.get('protocol')!r:.40}; update the older of the two",
                )
            self.greeted, self._explain = True, message.get("explain") is True
            return self.greeting
        if kind == "bye":
            self.connect(now)
            self.closed = True
            return {"type": "bye", "reason": "as the client said"}
        if not self.greeted:
            text = f"{kind!r:.40} before hello: send hello with protocol {VERSION}"
            raise ProtocolError("state", text)
        if kind == "heartbeat":
            return self._heartbeat()
        if kind == "reset":
            return self._reset(observed(message, self._most_turned), now)
        if kind not in ("observe", "stop"):
            types = "hello, reset, observe, heartbeat, stop, bye"
            raise ProtocolError("type", f"unknown type {kind!r:.40}; known: {types}")
        if self.state == "idle":
            raise ProtocolError("state", f"{kind} before reset: send reset first")
        if kind == "stop":
            self._stop("the client said stop", now)
            return self._command(now)
        return self._observe(observed(message, self._most_turned), now)

    def _reset(self, observation: Observed, now: float) -> Message:
        if problem := exceeded(self._settings, observation.pose, observation.wrench):
            raise ProtocolError("limit", f"no reset: {problem}", observation.seq)
        if self.state == "idle":
            self._begin(observation, now)
        try:
            self._agent.reset(observation.values)
            if (expected := self._agent.forecast()) is not None:
                # What the agent itself turns by, and what the hand may be beside it.
                turned = float(np.abs(expected.mean[:, 3:]).max())
                turned += self._settings.follow_angle
                self._most_turned = max(turned, MOST_TURNED)
        except BaseException as error:  # whatever a user's agent raises
            self.state = "active"  # a reset during a stop that fails is a new fault
            self._stop(_failure(error), now)
            raise ProtocolError("agent", self.reason, observation.seq) from error
        self._begin(observation, now)
        self.state, self.reason, self._heard = "active", "", now
        return {"type": "ready", "seq": observation.seq, "state": self.state}

    def _begin(self, observation: Observed, now: float) -> None:
        """Forget what was commanded; the hand is where it is observed."""
        self._seq, self._offset_at = observation.seq, now
        self._offset = now - observation.time
        # The first observation may be the same as in the reset.
        self._time = math.nextafter(observation.time, -math.inf)
        self._next = observation.time - _BURST * CONTROL_PERIOD
        self._fault_since = self._away_since = math.inf
        self._pose, self._soft = observation.pose, False
        arm_yields = self._control == "impedance"
        self._stiffness = self._softest if arm_yields else DEFAULT_PROFILE.k_max
        self._decided: Message = {}

    def _observe(self, observation: Observed, now: float) -> Message:
        """Check that an observation is the next, and the robot; return the command.

        An observation is late if its delay exceeds the shortest by `hold_after`, which
        increases with the greatest drift of the clocks.
        """
        settings, (seq, time, pose, wrench, _) = self._settings, observation
        if seq <= self._seq or time <= self._time:
            code = "duplicate" if seq == self._seq else "order"
            last = f"seq {self._seq} at {self._time} s"
            text = f"seq {seq} at {time} s does not follow {last}"
            raise ProtocolError(code, text, seq)
        drift = _DRIFT * (now - self._offset_at)
        self._offset = min(self._offset + drift, now - time)
        self._offset_at = now
        delay = now - time - self._offset
        if delay > settings.hold_after:
            text = f"seq {seq} is {delay:.3f} s older than others were"
            raise ProtocolError("late", text, seq)
        if time < self._next:
            text = f"seq {seq} comes before its time: one per {CONTROL_PERIOD} s"
            raise ProtocolError("early", text, seq)
        earliest = time - _BURST * CONTROL_PERIOD
        self._next = max(self._next, earliest) + CONTROL_PERIOD
        missed, silent = seq - self._seq - 1, time - self._time
        self._seq, self._time, self._heard, step = seq, time, now, None
        if silent >= settings.stop_after:
            self._stop("no valid observation in the robot's time", now)
        if self.state != "stopped":
            # Whether the robot must stop, and why.
            away = exceeds_following_error(settings, pose, self._pose)
            self._away_since = min(self._away_since, time) if away else math.inf
            self.reason = exceeded(settings, pose, wrench)
            if not self.reason and time - self._away_since >= settings.follow_time:
                self.reason = "the robot does not follow"
            if not self.reason:
                self.state, self._fault_since = "active", math.inf
                step = self._decision(observation, now)
            else:
                self.state = "holding"
                self._fault_since = min(self._fault_since, time)
                if time - self._fault_since >= settings.stop_after:
                    self._stop(self.reason, now)
        reply = self._command(now, step)
        return {**reply, "missed": missed} if missed else reply

    def _decision(self, observation: Observed, now: float) -> AgentStep | None:
        """Return the step of the agent, or stop if it must not be commanded."""
        try:
            step = self._agent.act(observation.values)
            width = getattr(self._agent, "gripper_width", None)
            width = {} if width is None else {"gripper_width": float(width)}
            command = step.command(self._control)
            finite = np.isfinite([*command, *width.values()]).all()
        except BaseException as error:  # whatever a user's agent raises
            self._stop(_failure(error), now)
            return None
        most = self._most_turned
        if not finite or np.abs(step.action[3:]).max() > most:
            text = f"the agent's command is not finite, or beyond ±{most} rad"
        elif not self._decided and exceeds_following_error(
            self._settings, observation.pose, step.action
        ):
            text = "the agent begins far from the hand"
        else:
            frame, phase = numbers(step.frame), numbers(step.phase)
            self._decided = {"frame": frame, "phase": phase, **width}
            return step
        self._stop(text, now)
        return None

    def _stop(self, reason: str, now: float) -> None:
        if self.state != "stopped":
            self.state, self.reason, self._soft = "stopped", reason, False
            self._stopped_at, self._stiffness_then = now, self._stiffness

    def _command(self, now: float, step: AgentStep | None = None) -> Message:
        """Return the command of a step, or the last pose, within the limits."""
        pose, stiffness = self._pose, self._stiffness
        if step is not None:
            # An agent without stiffness is followed as one without uncertainty.
            finite = np.isfinite(step.stiffness)
            stiffness = np.where(finite, step.stiffness, DEFAULT_PROFILE.k_max)
            pose = step.action
        elif self.state == "stopped":
            share = min((now - self._stopped_at) / self._settings.soften_time, 1.0)
            fall = self._softest - self._stiffness_then
            stiffness = self._stiffness_then + share * fall
            self._soft = share == 1.0
        self._commanded = now
        self._pose, self._stiffness, acted = limited(
            self._settings, pose, stiffness, self._pose
        )
        dynamics = self._dynamics or DEFAULT_DYNAMICS
        command = {
            "type": "command",
            "seq": self._seq,
            "state": self.state,
            "reason": self.reason,
            "pose": numbers(self._pose),
            "stiffness": numbers(self._stiffness),
            "damping": numbers(dynamics.damping(self._stiffness)),
            **self._decided,
        }
        if acted:
            command["limited"] = acted
        if step is not None and self._explain:
            command["step"] = {n: numbers(getattr(step, n)) for n in STEP_SHAPES}
        return command


def _failure(error: BaseException) -> str:
    return f"the agent failed with {type(error).__name__}: {error}"


def limited(
    settings: ServeSettings, pose: np.ndarray, stiffness: np.ndarray, last: np.ndarray
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return a command within the limits, given the last commanded pose.

    The position is moved to the nearest point of the workspace. A step that exceeds the
    speed limits is shortened, along line and shortest rotation from the last pose (6,).

    Returns:
        The pose (6,) [m, rad], the same object if no limit changed it; the stiffness
        (6,) [N/m, N m/rad], NaN if unknown; and the limits that changed them.
    """
    acted = []
    low, high = np.reshape(settings.workspace, (2, 3))
    position, rotation = pose[:3], pose[3:]
    inside = np.minimum(np.maximum(position, low), high)
    if not np.array_equal(inside, position):
        acted.append("workspace")
        position = inside
    shift = position - last[:3]
    distance, most = math.hypot(*shift), settings.linear_speed * CONTROL_PERIOD
    if distance > most:
        acted.append("linear_speed")
        position = last[:3] + shift * (most / distance)
    angle, most = rotation_distance(rotation, last[3:]), settings.angular_speed
    most *= CONTROL_PERIOD
    if angle > most:
        acted.append("angular_speed")
        turn = compose_rotvecs(rotation, -last[3:])
        rotation = compose_rotvecs(turn * (most / angle), last[3:])
    if acted:
        pose = np.concatenate([position, rotation])
    bounds = np.repeat((settings.least_stiffness, settings.greatest_stiffness), 3, 1)
    within = np.minimum(np.maximum(stiffness, bounds[0]), bounds[1])
    if not np.array_equal(within, stiffness, equal_nan=True):
        acted.append("stiffness")
        stiffness = within
    return pose, stiffness, acted


def exceeded(settings: ServeSettings, pose: np.ndarray, wrench: np.ndarray) -> str:
    """Return the limit that a measured pose or wrench exceeds, or ""."""
    low, high = np.reshape(settings.workspace, (2, 3))
    if (pose[:3] < low).any() or (pose[:3] > high).any():
        return "hand outside the workspace"
    if math.hypot(*wrench[:3]) > settings.force:
        return "measured force beyond its limit"
    if math.hypot(*wrench[3:]) > settings.moment:
        return "measured moment beyond its limit"
    return ""


def exceeds_following_error(
    settings: ServeSettings, pose: np.ndarray, command: np.ndarray
) -> bool:
    """Return whether the hand is farther from its command than the limits allow."""
    distance = math.hypot(*(pose[:3] - command[:3]))
    angle = rotation_distance(pose[3:], command[3:])
    return bool(distance > settings.follow_distance or angle > settings.follow_angle)
