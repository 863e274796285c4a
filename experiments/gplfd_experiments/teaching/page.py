"""The local web page on which a person leads the hand, and its server.

The page sends the input and receives the next picture; without requests nothing moves.
"""

import io
import json
import queue
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from PIL import Image

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_experiments.episodes.task import named_doors
from gplfd_experiments.files.plain_data import parsed_json
from gplfd_experiments.teaching.lesson import (
    CorrectedSkill,
    DemonstrationLesson,
    Lesson,
    TaughtSet,
    checked_input,
)

PRESSES: Final = ("", "start", "stop", "keep", "repeat", "discard", "next", "finish")
"""Buttons of the page; "" for none."""

# Control periods per request; on a slower computer, the simulation is slower.
_MOST: Final = 10
_LARGEST: Final = 10_000  # Largest size of a request [bytes].
_SILENCE: Final = 10.0  # A connection without a request for this time is closed [s].
# Names of this machine that other machines cannot reach.
_LOOPBACK: Final = ("127.0.0.1", "localhost")


class TeachingSession:
    """A session of a person at several doors, in turn.

    An episode is ready, led, played back, and then kept, repeated or discarded. It
    begins with the first non-zero input, or when Start is pressed.
    """

    def __init__(
        self, doors: Sequence[Callable[[], Lesson]], store: TaughtSet | CorrectedSkill
    ) -> None:
        self._doors, self._store = [*doors], store
        self._moving: list[int] = []
        self._lesson = self._doors[0]()
        try:
            self._lesson.picture()
        except RuntimeError as error:
            raise OSError(str(error)) from error
        self._begin()

    def _begin(self, note: str = "") -> None:
        self._lesson.restart()
        self.phase, self._since = "ready", 0.0
        self._message = f"{note} {self._lesson.invitation}".strip()

    def _stop(self, now: float) -> None:
        try:
            self._message = f"{self._lesson.result()} Keep it?"
            self._moving = self._lesson.moving()
        except ValueError as error:
            self._begin(f"{error}.")
            return
        self.phase, self._since = "shown", now

    def exchange(self, request: Mapping[str, Any], now: float) -> tuple[Any, bytes]:
        """Process a checked input at a time [s]; return state, as JSON, and picture."""
        sample, press = checked_input(request.get("input")), request.get("press", "")
        if press not in PRESSES:
            raise ValueError(f"press {press!r:.40} must be one of {PRESSES}")
        if press in ("stop", "keep") and self.phase == "leading":
            self._stop(now)
        if press == "keep" and self.phase == "shown":
            try:
                self._store.keep(self._lesson.record())
            except (OSError, ValueError) as error:
                self._message = f"Not kept: {error}. Keep it again, or repeat it."
            else:
                self._begin("Kept.")
        elif press == "repeat":
            self._begin("Repeat it.")
        elif press in ("discard", "next"):
            self._lesson.close()
            self._doors.append(self._doors.pop(0))
            self._lesson = self._doors[0]()
            self._begin()
        elif press == "finish":
            self.phase = "finished"
            number, place = len(self._store.kept), self._store.place
            what = "recording is" if number == 1 else "recordings are"
            self._message = f"Finished: {number} {what} kept in {place}."
        lesson = self._lesson
        if self.phase == "ready" and (sample.any() or press == "start"):
            self.phase, self._since = "leading", now - CONTROL_PERIOD
            self._message = lesson.request
        due = round((now - self._since) / CONTROL_PERIOD)
        if self.phase == "leading":
            self._since += CONTROL_PERIOD * due
            for _ in range(min(due, _MOST)):
                lesson.step(sample)
                if lesson.over:
                    self._stop(now)
                    break
        elif self.phase == "shown":
            lesson.show(self._moving[due % len(self._moving)])
        state = lesson.state | {"phase": self.phase, "message": self._message}
        state["kept"] = len(self._store.kept)
        file = io.BytesIO()
        if self.phase != "finished":
            Image.fromarray(lesson.picture()).save(file, "JPEG", quality=80)
        return state, file.getvalue()


def teach(
    doors: Sequence[str],
    folder: Path,
    page: Mapping[str, Any],
    options: Mapping[str, Any],
) -> int:
    """Serve the page until the person finishes; return how many demonstrations exist.

    The page has device, host and port. OSError: the address or the renderer fails.
    """
    named = named_doors(doors).items()
    lessons = [partial(DemonstrationLesson, *door, drawn=True) for door in named]
    store = TaughtSet(folder, options)
    serve(TeachingSession(lessons, store), "teach", **page)
    return len(store.kept)


def serve(
    session: TeachingSession, task: str, *, device: str, host: str, port: int
) -> None:
    """Serve the page, entitled by the task, until the person finishes."""
    # Pictures are drawn in the thread that made the session; requests wait for it.
    requests: queue.SimpleQueue[Any] = queue.SimpleQueue()
    page = files(__package__).joinpath("page.html").read_text(encoding="utf-8")
    content = page.replace("{{device}}", device).replace("{{task}}", task).encode()

    class Handler(BaseHTTPRequestHandler):
        protocol_version, disable_nagle_algorithm = "HTTP/1.1", True
        timeout = _SILENCE

        def do_GET(self) -> None:
            if self.path != "/":
                return self.send_error(404)
            self.send(200, "text/html; charset=utf-8", content)

        def do_POST(self) -> None:
            # Another site's page cannot send JSON, nor name this address as its host.
            kind, name = self.headers["Content-Type"], self.headers["Host"] or ""
            trusted = host not in _LOOPBACK or name.rsplit(":", 1)[0] in _LOOPBACK
            length = self.headers["Content-Length"] or ""
            if kind != "application/json" or not trusted:
                return self.send_error(403)
            if not length.isdecimal() or int(length) > _LARGEST:
                return self.send_error(413)
            reply: queue.Queue[Any] = queue.Queue()
            requests.put((self.rfile.read(int(length)), reply))
            try:
                self.send(*reply.get())
            except ConnectionError:
                self.close_connection = True  # The page was closed.
            finally:
                reply.task_done()

        def send(self, status: int, kind: str, content: bytes, state: str = "") -> None:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            self.send_header("X-State", state)
            # No page of another site may show this one in a frame.
            self.send_header("X-Frame-Options", "DENY")
            self.send_header("Content-Security-Policy", "frame-ancestors 'none'")
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_: Any) -> None:
            """Log nothing, because there are thirty requests per second."""

    try:
        server = ThreadingHTTPServer((host, port), Handler)
    except OSError as error:
        raise OSError(error.errno, f"{error.strerror}; give another --port") from error
    with server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        # Also printed with --quiet, because the address is required.
        print(f"{task} at  http://{host}:{server.server_port}", file=sys.stderr)
        while session.phase != "finished":
            body, reply = requests.get()
            try:
                request = parsed_json(body.decode())
                state, picture = session.exchange(request, time.monotonic())
                reply.put((200, "image/jpeg", picture, json.dumps(state)))
            except ValueError as error:
                reply.put((400, "text/plain; charset=utf-8", str(error).encode()))
        reply.join()  # The page knows it.
        server.shutdown()
