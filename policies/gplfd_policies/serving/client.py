"""The client: uses a served agent as an agent in this process, of a robot or simulator.

Needs only NumPy, the standard library and this package.
"""

import socket
import subprocess
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gplfd_env.conventions.constants import Control
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_policies.control.steps import AgentStep, Observation
from gplfd_policies.serving import protocol
from gplfd_policies.serving.protocol import Connection, array, decode, encode, numbers


class ServerLostError(ConnectionError):
    """The server is gone or does not answer in time: the client must hold the robot."""


class RefusedError(ValueError):
    """The server answered with an error; docs/robot.md lists the values of `code`."""

    def __init__(self, reply: Mapping[str, Any]) -> None:
        super().__init__(f"{reply['code']}: {reply['message']}")
        self.code = str(reply["code"])


class RemoteAgent:
    """An agent that a server computes: `reset`, then `act` once per control period.

    Args:
        address: ``unix:PATH``, ``tcp:HOST:PORT``, or a command that serves on its
            standard input and output, as a list of words.
        timeout: Longest wait for a reply [s].
        explain: Request all fields of `AgentStep`, not only the command.

    Raises:
        ServerLostError: There is no answer.
        RefusedError: The server speaks another version, or has another client.
    """

    def __init__(
        self,
        address: str | Sequence[str],
        *,
        timeout: float = 5.0,
        explain: bool = False,
    ) -> None:
        self._timeout, self._seq = timeout, 0
        self._process: Any = None
        self._waiting: list[bytes] = []
        self.last: dict[str, Any] = {}
        """The last command: state, reason, stiffness, damping, gripper_width, ..."""
        try:
            if isinstance(address, str):
                self._socket = _connected(address)
                ends = (self._socket.fileno(),) * 2
            else:
                pipe = subprocess.PIPE
                self._process = subprocess.Popen(address, stdin=pipe, stdout=pipe)
                ends = self._process.stdout.fileno(), self._process.stdin.fileno()
        except OSError as error:
            raise ServerLostError(f"nobody serves on {address}: {error}") from error
        self._link = Connection(*ends)
        try:
            hello = {"type": "hello", "protocol": protocol.VERSION, "explain": explain}
            self.greeting = self._reply(hello, "hello", None)
        except (ConnectionError, ValueError):
            self.close()
            raise
        self.control: Control = self.greeting["control"]
        self.dynamics = None

    def inform(self, door: DoorGeometry) -> None:
        """Ignore the door: only an oracle uses it, and oracles are not served."""

    def reset(self, observation: Observation) -> None:
        """Begin an episode, also after a stop; the hand must be at the start."""
        self._ask("reset", observation, "ready")

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period; see `last` for its state.

        Raises:
            RefusedError: The server did not accept this observation.
            ServerLostError: The server is gone or does not answer.
        """
        command = self.last = self._ask("observe", observation, "command")
        names = {"stiffness", "frame", "phase"} & command.keys()
        step = {name: command[name] for name in names} | command.get("step", {})
        step["action"], via_point = command["pose"], bool(step.pop("via_point", False))
        fields = {name: array(value) for name, value in step.items()}
        return AgentStep(**fields, via_point=via_point)

    def stop(self) -> None:
        """Request the server to soften and stop."""
        self._link.send(encode({"type": "stop"}))

    @property
    def gripper_width(self) -> float | None:
        """Gripper width of the last command [m]; None if the agent commands none."""
        return self.last.get("gripper_width")

    def close(self) -> None:
        """Disconnect; a server that was started as a command ends."""
        self._link.send(encode({"type": "bye"}))
        if self._process is None:
            self._socket.close()
            return
        try:
            self._process.communicate(timeout=self._timeout)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()

    def _ask(self, kind: str, observation: Observation, reply: str) -> dict[str, Any]:
        """Send an observation as numbers, and return the reply."""
        self._seq += 1
        values = {
            name: float(value[0]) if name == "time" else numbers(np.ravel(value))
            for name, value in observation.items()
        }
        return self._reply({"type": kind, "seq": self._seq, **values}, reply, self._seq)

    def _reply(
        self, message: Mapping[str, Any], kind: str, seq: int | None
    ) -> dict[str, Any]:
        """Send a message; return the reply, skipping unsolicited messages."""
        self._link.send(encode(message))
        until = time.monotonic() + self._timeout
        while True:
            while self._waiting:
                reply = decode(self._waiting.pop(0))
                if reply["type"] == "error":
                    raise RefusedError(reply)
                solicited = reply.get("seq") == seq and "unsolicited" not in reply
                if reply["type"] == kind and solicited:
                    return reply
            left = max(until - time.monotonic(), 0.0)
            self._link.send()
            self._waiting = self._link.lines(left)
            if not self._waiting and (self._link.closed or left == 0.0):
                what = "closed the connection" if self._link.closed else "is silent"
                raise ServerLostError(f"the server {what}; hold the robot")


def _connected(address: str) -> socket.socket:
    """Return a socket connected to ``unix:PATH`` or ``tcp:HOST:PORT``."""
    kind, _, place = address.partition(":")
    if kind == "unix":
        connection = socket.socket(socket.AF_UNIX)
        try:
            connection.connect(place)
        except OSError:
            connection.close()
            raise
        return connection
    host, _, port = place.rpartition(":")
    if kind != "tcp" or not port.isdecimal():
        raise ValueError(f"address {address!r} must be unix:PATH or tcp:HOST:PORT")
    connection = socket.create_connection((host.strip("[]"), int(port)))
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection
