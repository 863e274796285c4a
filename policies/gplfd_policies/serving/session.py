"""State of a served agent: checks of messages, watchdog and commands.

There is no input or output here, and time is an argument, so that every fault can be
tested without waiting. docs/serving.md defines the states.
"""

import math
from typing import Final

import numpy as np

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_policies.agents.agent import Agent
from gplfd_policies.control.steps import STEP_SHAPES, AgentStep
from gplfd_policies.control.stiffness import VirtualDynamics
from gplfd_policies.demonstrations.npz import FRAME
from gplfd_policies.serving.limits import exceeded, exceeds_following_error, limited
from gplfd_policies.serving.protocol import (
    MOST_TURNED,
    UNITS,
    VERSION,
    Message,
    Observed,
    ProtocolError,
    numbers,
    observed,
)
from gplfd_policies.serving.settings import LIMITS, WATCHDOG, ServeSettings, State

HEARTBEAT: Final = 0.25
"""Longest silence of the server while a client is connected [s]."""

_DRIFT: Final = 1e-3
"""Greatest relative drift of the two clocks [s/s]."""

_BURST: Final = 1.5
"""Number of periods by which an observation may be early, because of jitter."""


class Session:
    """Successive connections to one agent.

    Args:
        agent: Agent that acts once per control period of the robot's clock.
        settings: Watchdog and limits.
        address: Address of clients, for the greeting.
    """

    def __init__(self, agent: Agent, settings: ServeSettings, address: str) -> None:
        self._agent, self._settings = agent, settings
        self._dynamics: VirtualDynamics | None = getattr(
            getattr(agent, "config", None), "dynamics", None
        )
        self._softest = np.repeat(settings.least_stiffness, 3)
        described = settings.described()
        self.greeting: Message = {
            "type": "hello",
            "protocol": VERSION,
            "control": agent.control,
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
        self.state: State = "idle"
        self.reason = ""
        self.greeted = self.closed = self._explain = False
        self._spoke = now  # when something was sent last

    @property
    def due(self) -> float:
        """Time of the next message of `tick`, unless a message arrives before [s]."""
        if self._commands_by_itself:
            return self._spoke + CONTROL_PERIOD
        beat = self._spoke + HEARTBEAT if self.greeted else math.inf
        if self.state == "active":
            beat = min(beat, self._heard + self._settings.hold_after)
        return beat

    @property
    def _commands_by_itself(self) -> bool:
        return self.state == "holding" or (self.state == "stopped" and not self._soft)

    def receive(self, message: Message, now: float) -> list[Message]:
        """Return the replies to a decoded message that arrived now [s]."""
        replies = self.tick(now)  # it may have come too late
        try:
            replies.append(self._reply(message, now))
        except ProtocolError as error:
            replies.append(error.reply)
        self._spoke = now
        return replies

    def tick(self, now: float) -> list[Message]:
        """Return unsolicited messages due now [s]: holding, softening, heartbeat."""
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
        if self._commands_by_itself:
            return [self._command(now, unsolicited=True)]
        return [self._heartbeat()]

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
            return self._reset(observed(message), now)
        if kind not in ("observe", "stop"):
            types = "hello, reset, observe, heartbeat, stop, bye"
            raise ProtocolError("type", f"unknown type {kind!r:.40}; known: {types}")
        if self.state == "idle":
            raise ProtocolError("state", f"{kind} before reset: send reset first")
        if kind == "stop":
            self._stop("the client said stop", now)
            return self._command(now)
        return self._observe(observed(message), now)

    def _heartbeat(self) -> Message:
        return {"type": "heartbeat", "state": self.state, "reason": self.reason}

    def _reset(self, observation: Observed, now: float) -> Message:
        pose, wrench = observation.values["ee_pose"], observation.values["wrench"]
        if problem := exceeded(self._settings, pose, wrench):
            raise ProtocolError("limit", f"no reset: {problem}", observation.seq)
        try:
            self._agent.reset(observation.values)
        except Exception as error:  # whatever a user's agent raises
            self.state, self.reason = "idle", _failure(error)
            raise ProtocolError("agent", self.reason, observation.seq) from error
        self.state, self.reason = "active", ""
        self._soft, self._heard = False, now
        self._seq, self._offset_at = observation.seq, now
        self._offset = now - observation.time
        # The first observation may be the same as in the reset.
        self._time = math.nextafter(observation.time, -math.inf)
        self._next = observation.time - _BURST * CONTROL_PERIOD
        self._fault_since = self._away_since = math.inf
        self._pose = pose
        stiffness = self._softest if self._agent.control == "impedance" else np.nan
        self._stiffness = np.full(6, stiffness)
        self._decided: Message = {}
        return {"type": "ready", "seq": observation.seq, "state": self.state}

    def _observe(self, observation: Observed, now: float) -> Message:
        silent = observation.time - self._time
        missed = self._check_order(observation, now)
        self._heard, step = now, None
        if silent >= self._settings.stop_after:
            self._stop("no valid observation in the robot's time", now)
        if self.state != "stopped":
            self.reason = self._fault(observation)
            if not self.reason:
                self.state, self._fault_since = "active", math.inf
                step = self._decision(observation, now)
            else:
                self.state = "holding"
                self._fault_since = min(self._fault_since, observation.time)
                if observation.time - self._fault_since >= self._settings.stop_after:
                    self._stop(self.reason, now)
        reply = self._command(now, step)
        return {**reply, "missed": missed} if missed else reply

    def _check_order(self, observation: Observed, now: float) -> int:
        """Raise if an observation is not the next; return the number of lost ones.

        An observation is late if its delay exceeds the shortest delay by `hold_after`.
        The shortest delay is increased with the greatest drift of the clocks.
        """
        if observation.seq <= self._seq or observation.time <= self._time:
            code = "duplicate" if observation.seq == self._seq else "order"
            text = (
                f"seq {observation.seq} at {observation.time} s does not follow seq "
                f"{self._seq} at {self._time} s"
            )
            raise ProtocolError(code, text, observation.seq)
        drift = _DRIFT * (now - self._offset_at)
        self._offset = min(self._offset + drift, now - observation.time)
        self._offset_at = now
        delay = now - observation.time - self._offset
        if delay > self._settings.hold_after:
            text = f"seq {observation.seq} is {delay:.3f} s older than others were"
            raise ProtocolError("late", text, observation.seq)
        if observation.time < self._next:
            text = (
                f"seq {observation.seq} comes before its time: one per "
                f"{CONTROL_PERIOD} s"
            )
            raise ProtocolError("early", text, observation.seq)
        earliest = observation.time - _BURST * CONTROL_PERIOD
        self._next = max(self._next, earliest) + CONTROL_PERIOD
        missed = observation.seq - self._seq - 1
        self._seq, self._time = observation.seq, observation.time
        return missed

    def _fault(self, observation: Observed) -> str:
        """Return the reason why the robot must stop, or ""."""
        pose, away = observation.values["ee_pose"], 0.0
        if exceeds_following_error(self._settings, pose, self._pose):
            self._away_since = min(self._away_since, observation.time)
            away = observation.time - self._away_since
        else:
            self._away_since = math.inf
        if problem := exceeded(self._settings, pose, observation.values["wrench"]):
            return problem
        lost = self._away_since < math.inf and away >= self._settings.follow_time
        return "the robot does not follow" if lost else ""

    def _decision(self, observation: Observed, now: float) -> AgentStep | None:
        """Return the step of the agent, or stop if it must not be commanded."""
        try:
            step = self._agent.act(observation.values)
            finite = np.isfinite(step.command(self._agent.control)).all()
        except Exception as error:  # whatever a user's agent raises
            self._stop(_failure(error), now)
            return None
        if not finite or np.abs(step.action[3:]).max() > MOST_TURNED:
            text = f"the agent's command is not finite, or beyond ±{MOST_TURNED} rad"
        elif not self._decided and exceeds_following_error(
            self._settings, observation.values["ee_pose"], step.action
        ):
            text = "the agent begins far from the hand"
        else:
            return step
        self._stop(text, now)
        return None

    def _stop(self, reason: str, now: float) -> None:
        if self.state != "stopped":
            self.state, self.reason = "stopped", reason
            self._stopped_at, self._stiffness_then = now, self._stiffness

    def _command(
        self, now: float, step: AgentStep | None = None, *, unsolicited: bool = False
    ) -> Message:
        """Return the command of a step, or the last pose, within the limits."""
        pose, stiffness = self._pose, self._stiffness
        if step is not None:
            pose, stiffness = step.action, step.stiffness
            self._decided = {"frame": numbers(step.frame), "phase": numbers(step.phase)}
            width = getattr(self._agent, "gripper_width", None)
            if width is not None:
                self._decided["gripper_width"] = float(width)
        elif self.state == "stopped":
            share = min((now - self._stopped_at) / self._settings.soften_time, 1.0)
            fall = self._softest - self._stiffness_then
            stiffness = self._stiffness_then + share * fall
            self._soft = share == 1.0
        self._pose, self._stiffness, acted = limited(
            self._settings, pose, stiffness, self._pose
        )
        rendered = np.isfinite(self._stiffness).all()
        command = {
            "type": "command",
            "seq": self._seq,
            "state": self.state,
            "reason": self.reason,
            "pose": numbers(self._pose),
            "stiffness": numbers(self._stiffness) if rendered else None,
            **self._decided,
        }
        if rendered and self._dynamics is not None:
            command["damping"] = numbers(self._dynamics.damping(self._stiffness))
        if acted:
            command["limited"] = acted
        if unsolicited:
            command["unsolicited"] = True
        if step is not None and self._explain:
            command["step"] = {n: numbers(getattr(step, n)) for n in STEP_SHAPES}
        return command


def _failure(error: Exception) -> str:
    return f"the agent failed with {type(error).__name__}: {error}"
