"""Serve an agent by the openpi protocol: a WebSocket, and a session per connection.

Sessions check observations, and watch and limit commands, as in the line protocol. When
the agent does not act, a client gets a text without actions, and must hold its robot.
"""

import contextlib
import copy
import gc
import sys
import threading
import time
from typing import Any

import numpy as np

from gplfd_policies.agents.agent import Agent
from gplfd_policies.arrays.messages import LARGEST, check_installed, pack, unpack
from gplfd_policies.serving.protocol import VERSION, Journal, encode, numbers
from gplfd_policies.serving.session import Session
from gplfd_policies.serving.settings import ServeSettings


def serve_openpi(agent: Agent, settings: ServeSettings, journal: Journal) -> None:
    """Serve until an interruption; every connection has a copy of the agent."""
    check_installed()
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.server import serve

    writing = threading.Lock()

    def handle(connection: Any) -> None:
        session, seq = Session(copy.deepcopy(agent), settings, address), 0
        session.connect(time.monotonic())
        hello = encode({"type": "hello", "protocol": VERSION})
        session.receive(hello, time.monotonic())
        with contextlib.suppress(ConnectionClosed):
            connection.send(pack(session.greeting))
            for data in connection:
                began, seq = time.monotonic(), seq + 1
                line, reply = _reply(session, data, seq, began)
                connection.send(_answer(reply, agent.control))
                with writing:
                    journal.write(began, line, [reply], time.monotonic() - began)

    gc.collect()
    gc.freeze()
    host = settings.host
    options: Any = {"compression": None, "max_size": LARGEST}
    with serve(handle, host, settings.port, **options) as server:
        port = server.socket.getsockname()[1]
        address = f"ws://{f'[{host}]' if ':' in host else host}:{port}"
        text = f"gplfd: serving {settings.source} ({agent.control} control): {address}"
        print(text, file=sys.stderr, flush=True)
        server.serve_forever()


def _reply(
    session: Session, data: bytes | str, seq: int, now: float
) -> tuple[bytes | str, dict[str, Any]]:
    """Return an observation as a line, and the reply; the first one also resets."""
    try:
        observation = unpack(data if isinstance(data, bytes) else data.encode())
        fields = {
            name: numbers(np.asarray(value, np.float64))
            for name, value in observation.items()
            if np.ndim(value) < 2 and np.asarray(value).dtype.kind in "biuf"
        }
        kinds, reply = ("reset", "observe"), {"type": "", "state": ""}
        for kind in kinds if session.state == "idle" else kinds[1:]:
            if reply["type"] != "error":
                message = {**fields, "type": kind, "seq": 2 * seq + (kind == "observe")}
                line, (*_, reply) = session.receive(encode(message), now)
        return line, reply
    except (ValueError, TypeError, AttributeError) as error:
        return repr(data[:80]), {"type": "error", "message": f"no observation: {error}"}


def _answer(reply: dict[str, Any], control: str) -> bytes | str:
    """Return the actions of a reply, or why there are none."""
    if reply.get("state") == "active":
        action = reply["pose"] + reply["stiffness"] * (control == "impedance")
        actions = np.array([action], dtype=np.float64)
        if np.isfinite(actions).all():
            return pack({"actions": actions})
    return str(reply.get("message") or f"{reply['state']}: {reply['reason']}")
