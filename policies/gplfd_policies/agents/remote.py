"""A policy behind a WebSocket, in the openpi protocol: another process decides.

The server first sends its metadata, and then answers each observation with a chunk of
actions (H, 6) or (H, 12). They are executed open loop, one per control period, before
the next observation is sent. Every episode has a connection of its own.
"""

import contextlib
import json
import weakref
from collections.abc import Iterator, Mapping
from typing import Any, Final
from urllib.parse import urlsplit

import numpy as np

from gplfd_env.conventions.constants import CONTROL_PERIOD, Control
from gplfd_policies.arrays.messages import LARGEST, check_installed, pack, unpack
from gplfd_policies.control.rendering import VirtualRendering
from gplfd_policies.control.steps import AgentStep, Observation
from gplfd_policies.control.stiffness import DEFAULT_DYNAMICS

GREETING_LIMIT, ANSWER_LIMIT = 10.0, 60.0
"""Longest time until the metadata have arrived, and until an answer has [s]."""
PROMPT: Final = "open the door"
"""Entry ``prompt`` of every observation, for policies that follow language."""

FORMS: Final = {"pose": 6, "impedance": 12, "admittance": 12}
"""Numbers of an action by the entry ``control`` of the metadata, "pose" by default:
pose; pose and stiffness that the arm renders; or pose and stiffness by which the
admittance of `gplfd_policies.control` displaces the pose of a stiff arm."""

_LONGEST: Final = 10_000  # Greatest number of actions in a chunk.
_MOST_METADATA: Final = 8192  # They are part of every result [characters].


class ServerError(RuntimeError):
    """The server does not answer as the protocol says: the episode has failed."""


def is_address(name: str) -> bool:
    """Return whether the name of a policy is the address of a server."""
    return name.startswith(("ws://", "wss://"))


def stated_metadata(address: str) -> str:
    """Return the metadata of a server, as JSON; raises a ValueError without them."""
    check_installed()
    try:
        parts = urlsplit(address)
        if not parts.hostname or parts.port == 0 or "@" in parts.netloc:
            raise ValueError("it must be ws://HOST:PORT, without a password")
        socket, metadata = _connected(address)
        socket.close()
        ChunkAgent(address, metadata)
    except (ValueError, ServerError) as error:
        raise ValueError(f"policy {address!r}: {error}") from error
    return metadata


class ChunkAgent:
    """Executes the chunks of the server at an address, which states metadata (JSON).

    Raises:
        ValueError: The form of the actions is unknown.
    """

    def __init__(self, address: str, metadata: str) -> None:
        self._address, self._metadata = address, metadata
        form = str(json.loads(metadata).get("control", "pose"))
        if form not in FORMS:
            forms = ", ".join(FORMS)
            raise ValueError(f"its metadata have control {form!r:.40}, not of {forms}")
        self._form = form
        self._disconnect: Any = str
        self.control: Control = "impedance" if form == "impedance" else "pose"
        self._rendering = VirtualRendering(DEFAULT_DYNAMICS, CONTROL_PERIOD)

    def reset(self, observation: Observation) -> None:
        """Connect for an episode; raises `ServerError` if the server has changed."""
        self._disconnect()
        self._step, self._chunk = 0, np.empty((0, FORMS[self._form]))
        self._rendering.reset()
        self._socket, metadata = _connected(self._address)
        # Nobody tells an agent that its episode has ended.
        self._disconnect = weakref.finalize(self, self._socket.close)
        if metadata != self._metadata:
            raise ServerError(f"{self._address}: its metadata have changed meanwhile")

    def act(self, observation: Observation) -> AgentStep:
        """Return the next action of the chunk, or the first of a new one."""
        self._step += 1
        if not len(self._chunk):
            late = f"no answer within {ANSWER_LIMIT:g} s"
            with _reported(self._address, late, f", at step {self._step}"):
                self._chunk = self._answer(observation)
        action, self._chunk = self._chunk[0], self._chunk[1:]
        if self._form == "pose":
            return AgentStep(action=action)
        desired, stiffness, none = action[:6], action[6:], np.zeros(3)
        if self._form == "admittance":
            wrench: Any = {"compliant_wrench": observation["wrench"]}
            action = self._rendering.command(
                desired, none, stiffness, **wrench, compensated_force=none
            )
        return AgentStep(action=action[:6], desired=desired, stiffness=stiffness)

    def _answer(self, observation: Observation) -> np.ndarray:
        """Send an observation; return the answered actions (H, 6) or (H, 12)."""
        with contextlib.suppress(TimeoutError):
            self._socket.recv(timeout=0)
            raise ValueError("it sent an answer that nobody had asked for")
        values = {name: np.asarray(value) for name, value in observation.items()}
        self._socket.send(pack({**values, "prompt": PROMPT}))
        actions = _received(self._socket, ANSWER_LIMIT).get("actions")
        if not isinstance(actions, np.ndarray) or actions.dtype.kind not in "fiu":
            raise ValueError("its answer has no array of numbers 'actions'")
        size = FORMS[self._form]
        if actions.shape[1:] != (size,) or not 0 < len(actions) <= _LONGEST:
            wanted = f"(H, {size}), with H from 1 to {_LONGEST}"
            raise ValueError(f"its actions have shape {actions.shape}, not {wanted}")
        chunk: np.ndarray = actions.astype(np.float64)
        if not np.isfinite(chunk).all() or (chunk[:, 6:] <= 0.0).any():
            raise ValueError("its actions are not finite, or a stiffness not positive")
        return chunk


def _connected(address: str) -> tuple[Any, str]:
    """Return a connection and the metadata of the server, as JSON."""
    from websockets.sync.client import connect

    options: Any = {"compression": None, "proxy": None, "max_size": LARGEST}
    options |= {"open_timeout": GREETING_LIMIT, "close_timeout": 1.0}
    with _reported(address, f"no server answers within {GREETING_LIMIT:g} s"):
        # Without pings, to which a server does not reply while it computes.
        socket = connect(address, ping_interval=None, **options).__enter__()
    with _reported(address, f"no metadata within {GREETING_LIMIT:g} s"):
        try:
            metadata = _received(socket, GREETING_LIMIT)
            text = json.dumps(metadata, default=_plain, sort_keys=True, skipkeys=True)
            if len(text) > _MOST_METADATA:
                limit = f"{_MOST_METADATA} characters"
                raise ValueError(f"its metadata have more than {limit}")
        except BaseException:
            socket.close()
            raise
    return socket, text


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)


def _received(socket: Any, limit: float) -> Mapping[str, Any]:
    """Return the next message, within a time [s]."""
    data = socket.recv(timeout=limit)
    if isinstance(data, str):
        raise ValueError(f"it sent a text: {' '.join(data.split()):.300}")
    if not isinstance(message := unpack(data), dict):
        raise ValueError(f"its message must be a map, and not {message!r:.40}")
    return message


@contextlib.contextmanager
def _reported(address: str, late: str, where: str = "") -> Iterator[None]:
    """Raise a `ServerError` instead of what went wrong; a TimeoutError is `late`."""
    from websockets.exceptions import ConnectionClosed, WebSocketException

    try:
        yield
    except (ValueError, OSError, WebSocketException) as error:
        reason = str(error) or type(error).__name__
        if isinstance(error, TimeoutError):
            reason = late
        elif isinstance(error, ConnectionClosed):
            reason = f"the connection was closed ({error})"
        elif isinstance(error, OSError):
            reason = f"no server answers ({error})"
        raise ServerError(f"{address}: {reason}{where}") from error
