"""The page on which a person teaches: its session, its server, and a real browser."""

import contextlib
import http.client
import io
import json
import socket
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from gplfd_env.doors.config import door_config
from gplfd_experiments.cli.main import main
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.episodes.task import episode_task
from gplfd_experiments.teaching import page
from gplfd_experiments.teaching.lesson import (
    CorrectedSkill,
    CorrectionLesson,
    DemonstrationLesson,
    TaughtSet,
)
from gplfd_experiments.teaching.page import TeachingSession, teach
from gplfd_policies import load_skill
from gplfd_policies.demonstrations.npz import load_demonstrations
from gplfd_policies.registry.catalogue import skill_method
from gplfd_policies.registry.method import TrainingInput

pytestmark = [pytest.mark.slow, pytest.mark.needs("opengl")]

PULL = [0, 0, 0, 1, 0, 0, 0, 0, 0]
IDLE = [0] * 9


@pytest.fixture
def person(tmp_path: Path, visitor: Any) -> Any:
    lessons = [
        partial(DemonstrationLesson, name, door_config(name), drawn=True)
        for name in ("small", "medium")
    ]
    return visitor(TeachingSession(lessons, TaughtSet(tmp_path, {})))


def test_a_demonstration_is_led_shown_and_kept_repeated_or_discarded(
    tmp_path: Path, person: Any
) -> None:
    assert person(times=5)["time"] == 0.0
    assert person("stop")["phase"] == "ready"
    led = person(sample=PULL, times=25)
    assert (led["phase"], led["door"]) == ("leading", "small")
    assert led["time"] == pytest.approx(0.73)
    assert led["angle"] > 3.0
    assert Image.open(io.BytesIO(person.picture)).size == (480, 360)
    assert person("stop")["phase"] == "shown"
    frames = {(person(), person.picture)[1] for _ in range(12)}
    assert len(frames) > 6  # It moves.
    repeated = person("repeat")
    assert (repeated["phase"], repeated["door"], repeated["angle"] < 0.1) == (
        *("ready", "small"),
        True,
    )
    assert person(sample=PULL, times=25) == led | {"time": pytest.approx(0.73)}
    kept = person("keep")
    assert (kept["phase"], kept["kept"], kept["time"]) == ("ready", 1, 0.0)
    assert len(load_demonstrations(tmp_path).demonstrations) == 1
    person(sample=PULL, times=5)
    discarded = person("discard")
    assert (discarded["door"], discarded["kept"]) == ("medium", 1)
    assert person("next")["door"] == "small"
    assert person("finish")["phase"] == "finished"


def test_time_stands_still_while_the_page_is_silent(person: Any) -> None:
    before = person(sample=PULL, times=2)["time"]
    person.now += 10.0
    assert person(sample=PULL)["time"] == pytest.approx(before + 0.1)
    assert person(sample=PULL)["time"] == pytest.approx(before + 0.13)


def test_a_policy_begins_at_start_is_led_and_goes_on_corrected(
    tmp_path: Path, visitor: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(CorrectionLesson, "picture", lambda _: np.ones((3, 4, 3), "u1"))
    gp, names = skill_method("gp"), ("small", "medium")
    shown = Teacher().standard_demonstrations(seed=0)
    bars = gp.learn(TrainingInput(demonstrations=shown))
    store = CorrectedSkill(gp, bars, tmp_path / "better.npz")
    tasks = [episode_task(x, door_config(x), policy="gp", seed=0) for x in names]
    lessons = [
        partial(CorrectionLesson, task, store, "mouse", drawn=False) for task in tasks
    ]
    somebody = visitor(TeachingSession(lessons, store))
    assert somebody(times=20)["time"] == 0.0
    alone = [somebody("start"), somebody(times=60)][1]
    assert alone["angle"] > 1.0
    assert alone["hand"] == pytest.approx(alone["target"], abs=0.02)  # No spring.
    told = somebody("stop")
    assert told["phase"] == "ready"
    assert "The hand was not led" in told["message"]
    somebody("start")
    assert somebody(sample=PULL, times=40)["phase"] == "leading"
    told = somebody("stop")
    assert (told["phase"], told["kept"]) == ("shown", 0)
    assert "You led the hand for 1.2 s. Keep it?" in told["message"]
    assert somebody("keep")["kept"] == 1
    better = load_skill(store.place)
    assert (better.count, len(better.corrections)) == (bars.count + 1, 1)
    assert store.skill is not bars
    with_it = [somebody("start"), somebody(times=60)][1]
    assert (with_it["door"], with_it["angle"] != alone["angle"]) == ("small", True)
    assert somebody("discard")["door"] == "medium"
    assert somebody("finish")["message"] == (
        f"Finished: 1 recording is kept in {store.place}."
    )


def send(port: int, body: Any, **headers: str) -> tuple[int, str]:
    """Send a request as the page does; return status and text of the answer."""
    connection = http.client.HTTPConnection("127.0.0.1", port)
    with contextlib.closing(connection):
        kind = {"Content-Type": "application/json"}
        connection.request("POST", "/exchange", json.dumps(body), kind | headers)
        answer = connection.getresponse()
        return answer.status, answer.read().decode(errors="replace")


@contextlib.contextmanager
def serving(folder: Path, device: str = "mouse") -> Iterator[int]:
    """Run the server of a page at the door small; yield its port."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    options = {"device": device, "host": "127.0.0.1", "port": port}
    thread = threading.Thread(target=teach, args=(["small"], folder, options, {}))
    thread.daemon = True
    thread.start()
    try:
        until = time.monotonic() + 30.0
        while time.monotonic() < until:
            with contextlib.suppress(OSError):
                assert send(port, {"input": IDLE})[0] == 200
                break
            time.sleep(0.05)
        yield port
    finally:
        with contextlib.suppress(OSError):
            send(port, {"input": IDLE, "press": "finish"})
        thread.join(10.0)


def test_only_the_page_of_this_machine_is_answered(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page, "_SILENCE", 1.0)
    with serving(tmp_path / "set") as port:
        # Half a request does not hold a connection; no other site frames the page.
        with socket.create_connection(("127.0.0.1", port), timeout=20.0) as half:
            half.sendall(b"GET / HTTP/1.1\r\n\r\nPOST /exchange HTTP/1.1\r\n")
            answer = b"".join(iter(lambda: half.recv(65536), b""))
        assert b"X-Frame-Options: DENY" in answer
        assert b"frame-ancestors 'none'" in answer
        status, text = send(port, {"input": IDLE, "press": "jump"})
        assert (status, "press 'jump' must be one of" in text) == (400, True)
        assert send(port, {"input": IDLE}, Host="evil.example")[0] == 403
        assert send(port, {"input": IDLE}, **{"Content-Type": "text/plain"})[0] == 403
        other = ["--out", str(tmp_path / "other"), "--port", str(port)]
        assert main(["demos", "teach", *other]) == 2
        assert "give another --port" in capsys.readouterr().err


@pytest.mark.needs("chromium")
def test_a_mouse_in_a_browser_opens_a_door(tmp_path: Path, tab: Any) -> None:
    folder = tmp_path / "set"
    with serving(folder) as port:
        tab.call("Page.navigate", url=f"http://127.0.0.1:{port}/")
        tab.wait("document.title === 'ready 0'")
        place = "(b => [b.x, b.y, b.width])(canvas.getBoundingClientRect())"
        x, y, width = tab.value(place)
        # The handle of the closed door is drawn there.
        x, y = x + 0.45 * width, y + 0.306 * 0.75 * width
        tab.mouse("mousePressed", x, y, button="left", clickCount=1)
        for part in range(40):
            tab.mouse("mouseMoved", x, y + 0.004 * width * part, buttons=1)
            tab.wait("events.length === 0")
        tab.mouse("mouseReleased", x, y, button="left")
        assert float(tab.value("$('numbers').innerText.match(/([\\d.]+)°/)[1]")) > 5.0
        tab.value("document.querySelector('[value=stop]').click()")
        tab.wait("document.title === 'shown 0'")
        tab.call("Input.dispatchKeyEvent", type="keyDown", code="Enter", key="Enter")
        tab.wait("document.title === 'ready 1'")
        assert tab.errors == []
    assert len(load_demonstrations(folder).demonstrations) == 1


HID = """
  const found = new EventTarget();
  found.productName = "Cap"; found.open = async () => {};
  const hid = {requestDevice: async () => [found]};
  Object.defineProperty(navigator, "hid", {value: hid});
"""


@pytest.mark.needs("chromium")
def test_a_spacemouse_leads_along_the_axes_of_the_door(
    tmp_path: Path, tab: Any
) -> None:
    with serving(tmp_path / "set", "spacemouse") as port:
        tab.call("Page.enable")
        tab.call("Page.addScriptToEvaluateOnNewDocument", source=HID)
        tab.call("Page.navigate", url=f"http://127.0.0.1:{port}/")
        tab.wait("document.title === 'ready 0'")
        tab.value("$('connect').click()")
        tab.wait("$('help').innerText.startsWith('Cap is connected')")
        report = """found.oninputreport({reportId: %d, timeStamp: performance.now(),
            data: new DataView(new Int16Array(%s).buffer)})"""
        # Right, towards the person, down: -z, +x and -y of the task frame.
        tab.value(report % (1, [35, 175, 70]))
        assert tab.value("cap") == [0.5, -0.2, -0.1, 0, 0, 0]
        tab.value(report % (2, [0, 0, 350]))
        assert tab.value("cap") == [0.5, -0.2, -0.1, 0, -1, 0]
        tab.wait("document.title === 'leading 0'")
        tab.value("navigator.hid.ondisconnect()")
        assert tab.value("cap") == [0, 0, 0, 0, 0, 0]
        assert tab.errors == []
