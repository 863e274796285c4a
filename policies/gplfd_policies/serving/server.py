"""The loop of a served agent: transport, one client at a time, journal, memory."""

import contextlib
import gc
import os
import socket
import sys
import time
from collections.abc import Callable
from pathlib import Path

from gplfd_policies.agents.agent import Agent
from gplfd_policies.agents.reaching import ReachingAgent, learn_reach, openings, reaches
from gplfd_policies.demonstrations import npz
from gplfd_policies.registry.catalogue import make_agent, method_and_skill, policy_named
from gplfd_policies.serving.openpi import serve_openpi
from gplfd_policies.serving.protocol import (
    Connection,
    Journal,
    Message,
    ProtocolError,
    encode,
)
from gplfd_policies.serving.session import HEARTBEAT, Session
from gplfd_policies.serving.settings import ServeSettings


def served_agent(
    settings: ServeSettings, demonstrations: npz.LabelledDemonstrations | None = None
) -> Agent:
    """Make the agent of a skill file, or of a policy and demonstrations.

    `demonstrations` replaces their file. Raises a ValueError if it cannot be served.
    """
    source, file = settings.source, Path(settings.source)
    if file.suffix == ".npz":
        if settings.demonstrations is not None or settings.start != "grasped":
            raise ValueError(
                f"{file} is a skill, already learned and only for opening; leave out "
                "--demonstrations and --start"
            )
        method, skill = method_and_skill(settings.policy, file)
        npz.check_frame(skill.frame, file)
        return method.follow(skill)
    policy = policy_named(source)
    if policy.told:
        raise ValueError(f"policy {source!r} needs the true door, which no message has")
    if settings.demonstrations is not None:
        demonstrations = npz.load_demonstrations(settings.demonstrations)
        npz.check_frame(demonstrations.frame, settings.demonstrations)
    if demonstrations is None:
        if policy.kind != "reference" or settings.start == "approach":
            raise ValueError(
                f"policy {source!r} learns, or cannot reach by itself: give "
                "--demonstrations FILE.npz, or a skill file in its place"
            )
        return make_agent(source, (), seed=settings.seed)
    agent = make_agent(source, openings(demonstrations), seed=settings.seed)
    if settings.start == "approach":
        return ReachingAgent(learn_reach(reaches(demonstrations)), agent)
    return agent


class Server:
    """Serves one client at a time, those of a listening socket or one `link`.

    A client that was silent for the time after which the watchdog stops makes room for
    another. All times are those of `clock`, which is monotonic [s].
    """

    def __init__(
        self,
        session: Session,
        journal: Journal,
        listener: socket.socket | None = None,
        link: Connection | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._session, self._journal, self._clock = session, journal, clock
        self._listener, self._link = listener, link
        self._client: socket.socket | None = None
        self._heard = clock()
        session.connect(self._heard)

    def run(self) -> None:
        """Serve until the only client is gone, or forever if others may connect."""
        # Garbage collections then pass over all that exists before the first message.
        gc.collect()
        gc.freeze()
        try:
            while self.step():
                pass
        finally:
            if self._link is not None:
                self._link.send(encode({"type": "bye", "reason": "the server ends"}))
                self._leave("the server ends")

    def step(self) -> bool:
        """Wait for an event and handle it; return whether to continue."""
        link, session = self._link, self._session
        if link is None:
            return self._accept(None)
        wait = min(max(session.due - self._clock(), 0.0), HEARTBEAT)
        lines = link.lines(wait)
        link.send()
        for line in lines:
            began = self._clock()
            self._say(began, *session.receive(line, began))
            if session.greeted:
                self._heard = began
            if session.closed:
                break
        now = self._clock()
        if replies := session.tick(now):
            self._say(now, None, replies)
        if session.closed or link.closed:
            return self._leave("bye" if session.closed else "the client has gone")
        return self._listener is None or self._accept(0.0)

    def _say(
        self, began: float, received: bytes | str | None, replies: list[Message]
    ) -> None:
        """Send replies first, and then write the journal, which is slower."""
        if self._link is not None:
            self._link.send(b"".join(map(encode, replies)))
        self._journal.write(began, received, replies, self._clock() - began)

    def _accept(self, timeout: float | None) -> bool:
        """Accept a client, or refuse it while another one is heard."""
        if self._listener is None:
            return False
        self._listener.settimeout(timeout)
        try:
            client, _ = self._listener.accept()
        except (BlockingIOError, TimeoutError):
            return True
        silent = self._clock() - self._heard >= self._session.patience
        if silent and self._link is not None:
            self._leave("a silent client makes room")
        if self._link is not None:
            reply = ProtocolError("busy", "another client is connected").reply
            with contextlib.suppress(OSError), client:
                client.sendall(encode(reply))
            return True
        if client.family != getattr(socket, "AF_UNIX", None):
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._client, self._link = client, Connection(client.fileno(), client.fileno())
        self._heard = self._clock()
        self._session.connect(self._heard)
        self._journal.write(self._heard, "a client has come", [], 0.0)
        return True

    def _leave(self, reason: str) -> bool:
        """End the session of a client; return whether another may come."""
        state, now = self._session.state, self._clock()
        self._journal.write(now, f"{reason}; the session was {state}", [], 0.0)
        self._session.connect(now)
        if self._client is not None:
            self._client.close()
        self._link = self._client = None
        return self._listener is not None


def serve(
    settings: ServeSettings, demonstrations: npz.LabelledDemonstrations | None = None
) -> None:
    """Serve an agent by settings, until the client or an interruption ends it.

    ValueError: the agent cannot be served. OSError: address or journal are unusable.
    """
    with contextlib.ExitStack() as stack:
        listener, link, address = None, None, "standard input and output"
        if settings.socket is None and settings.port is None:
            # Prints of a policy, also in C, would otherwise be read as messages.
            sys.stdout.flush()
            output = os.dup(1)
            os.dup2(2, 1)
            stack.callback(os.close, output)
            stack.callback(os.dup2, output, 1)
            stack.callback(sys.stdout.flush)
            link = Connection(0, output)
        agent = served_agent(settings, demonstrations)
        journal = Journal(settings.journal, {"settings": settings.described()})
        stack.callback(journal.close)
        if settings.protocol == "openpi":
            return serve_openpi(agent, settings, journal)
        if link is None:
            listener, address = listening(settings)
            stack.enter_context(listener)
            if settings.socket is not None:
                stack.callback(settings.socket.unlink, missing_ok=True)
        session = Session(agent, settings, address)
        where = "beyond this machine" if settings.beyond_loopback else "on this machine"
        served = f"serving {settings.source} ({agent.control} control) {where}"
        print(f"gplfd: {served}: {address}", file=sys.stderr, flush=True)
        Server(session, journal, listener, link).run()


def listening(settings: ServeSettings) -> tuple[socket.socket, str]:
    """Return a listening socket and its address for clients."""
    if settings.socket is None:
        version = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
        listener = socket.create_server((settings.host, settings.port), family=version)
        return listener, f"tcp:{settings.host}:{listener.getsockname()[1]}"
    path = str(settings.socket)
    if settings.socket.is_socket():
        with socket.socket(socket.AF_UNIX) as other:
            if other.connect_ex(path) == 0:
                raise ValueError(f"another server listens on {path}")
        settings.socket.unlink()  # of a server that was killed
    listener = socket.socket(socket.AF_UNIX)
    before = os.umask(0o177)
    try:
        listener.bind(path)
        listener.listen()
    except OSError as error:
        listener.close()
        raise OSError(f"cannot listen on {path}: {error.strerror or error}") from error
    finally:
        os.umask(before)
    return listener, f"unix:{path}"
