"""A real browser that opens the page of a person who teaches."""

import json
import os
import shlex
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest


class Page:
    """A page, driven through the pipe of the DevTools protocol.

    Errors of its scripts are in `errors`.
    """

    def __init__(self, answers: Any, calls: Any) -> None:
        self._out, self._in = answers, calls
        self._rest, self._number, self._session = b"", 0, {}
        self.errors: list[str] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        session = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = {"sessionId": session["sessionId"]}
        self.call("Runtime.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        self._in.write(json.dumps(message | self._session).encode() + b"\0")
        self._in.flush()
        while True:
            while b"\0" not in self._rest:
                part = self._out.read1(65536)
                assert part, "the browser has ended"
                self._rest += part
            text, self._rest = self._rest.split(b"\0", 1)
            answer = json.loads(text)
            if answer.get("method") == "Runtime.exceptionThrown":
                self.errors.append(str(answer["params"]["exceptionDetails"]))
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return answer["result"]

    def value(self, script: str) -> Any:
        """Return the value of an expression, a promise's when it is fulfilled."""
        found = self.call(
            "Runtime.evaluate",
            expression=script,
            awaitPromise=True,
            returnByValue=True,
            userGesture=True,
        )
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def wait(self, condition: str, seconds: float = 20.0) -> None:
        """Wait until an expression is true."""
        loop = f"""new Promise((done, fail) => {{
            const until = performance.now() + {1000 * seconds};
            const test = () => ({condition}) ? done(1) :
                performance.now() > until ? fail(document.body.innerText)
                : setTimeout(test, 20);
            test(); }})"""
        self.value(loop)

    def mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)


class Visitor:
    """Somebody whose page exchanges every 30 ms."""

    def __init__(self, session: Any) -> None:
        self.session, self.now = session, 0.0

    def __call__(self, press: str = "", sample: Any = (0,) * 9, times: int = 1) -> Any:
        for _ in range(times):
            self.now += 0.03
            request = {"input": sample, "press": press}
            state, self.picture = self.session.exchange(request, self.now)
        json.dumps(state)
        return state


@pytest.fixture
def visitor() -> type[Visitor]:
    """Give somebody at the page of a session."""
    return Visitor


@pytest.fixture
def tab(tmp_path: Path) -> Iterator[Page]:
    """Return an empty page of a headless Chromium with its profile in the folder."""
    command = [
        shutil.which("chromium") or "google-chrome",
        "--headless=new",
        "--no-sandbox",
        "--disable-dev-shm-usage",
        "--disable-gpu",
        "--remote-debugging-pipe",
        f"--user-data-dir={tmp_path}",
        "--window-size=1000,1000",
        "about:blank",
    ]
    down, up = os.pipe(), os.pipe()
    with (tmp_path / "log").open("wb") as log:
        # The protocol is spoken on the files 3 and 4.
        process = subprocess.Popen(
            ["bash", "-c", f"exec {shlex.join(command)} 3<&{down[0]} 4>&{up[1]}"],
            pass_fds=(down[0], up[1]),
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
        )
    os.close(down[0])
    os.close(up[1])
    try:
        with os.fdopen(up[0], "rb") as answers, os.fdopen(down[1], "wb") as calls:
            yield Page(answers, calls)
    finally:
        process.terminate()
        process.wait(10)
