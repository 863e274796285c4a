"""``gplfd demos import``: from motion files to something that opens doors."""

import errno
import glob
import json
import os
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread as read_image
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from gplfd_experiments.cli import main as cli
from gplfd_experiments.data import importing
from gplfd_experiments.data.teacher import DEMONSTRATED_RADII, Teacher
from gplfd_policies.demonstrations.npz import FIRST_POSE, FRAME, load_demonstrations

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("coarse_cuts", "reads_here")]

START = np.array([1.0, 2.0, 0.9])
TURN = Rotation.from_rotvec([0.4, -0.2, 1.1])
SET_FILES = {"demonstrations.npz", "report.txt", "before_after.png", "import.json"}


@pytest.fixture(scope="module")
def tables() -> dict[str, str]:
    """Motions as a tracker in the room sees them: in cm, at 240 Hz."""
    rng, found = np.random.default_rng(0), {}
    grip = Rotation.from_rotvec([0.3, 0.7, -0.5])
    shown = Teacher().demonstrate_doors(DEMONSTRATED_RADII, 2, rng=rng)
    for number, motion in enumerate(shown):
        positions = 100.0 * (START + TURN.apply(motion.poses[:, :3].copy()))
        rotations = TURN * Rotation.from_rotvec(motion.poses[:, 3:].copy()) * grip
        columns = motion.times + 1000.0, positions, rotations.as_quat()
        rows = [",".join(f"{n:.6f}" for n in row) for row in np.column_stack(columns)]
        lines = ["time [s],x [cm],y [cm],z [cm],qx,qy,qz,qw", *rows, ""]
        found[f"{number}.csv"] = "\n".join(lines)
    return found


@pytest.fixture
def files(
    tables: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> list[str]:
    """Six motion files of three doors in the working folder."""
    monkeypatch.chdir(tmp_path)
    for name, table in tables.items():
        Path(name).write_text(table)
    return list(tables)


def imported(*arguments: str) -> int:
    return cli.main(["demos", "import", *arguments, "--quiet"])


@pytest.mark.usefixtures("no_picture")
def test_doors_are_found_in_what_a_tracker_in_the_room_saw(files, capsys):
    # As a shell that finds no such file leaves wildcards alone.
    assert imported("[0-9].csv", "--out", "set", "--frame", "hinge") == 0
    printed = capsys.readouterr().out
    assert "6 demonstrations in set" in printed
    assert "gplfd learn set --out set-skill.npz" in printed
    assert {file.name for file in Path("set").iterdir()} == SET_FILES
    kept = load_demonstrations("set")
    assert kept.frame == FRAME
    radii = [radius for radius in DEMONSTRATED_RADII for _ in range(2)]
    assert_allclose(np.array(kept.radii, dtype=float), radii, rtol=0.08)
    # The terminal has the first columns, and all notes.
    written, shown = Path("set/report.txt").read_text(), printed.partition("\n\n6 ")[0]
    head = next(line for line in shown.splitlines() if "from" in line)
    assert any(line.startswith(head) for line in written.splitlines())
    assert written.strip().endswith(shown.rpartition("\n\n")[2])
    origin = json.loads(Path("set/import.json").read_text())
    assert [one["name"] for one in origin["files"]] == files
    assert cli.main(["demos", "inspect", "set"]) == 2
    assert "its contents are in set/report.txt" in capsys.readouterr().err


@pytest.mark.filterwarnings("ignore:2 demonstrations leave")
@pytest.mark.usefixtures("no_picture")
def test_each_motion_relative_to_its_own_first_pose(files, caplog):
    assert imported(*files[:2], "--out", "set", "--cutoff", "0") == 0
    kept = load_demonstrations("set")
    assert kept.frame == FIRST_POSE
    # What is not in the frame of a door opens none, and the message says what to do.
    assert cli.main(["learn", "set", "--out", "skill.npz", "--quiet"]) == 0
    for command in (
        *("run --doors medium --skill skill.npz", "serve skill.npz"),
        *("run --doors medium --demonstrations set", "serve gp --demonstrations set"),
    ):
        assert cli.main(command.split()) == 2
        assert "import the recordings with gplfd demos import FILES" in caplog.text
        caplog.clear()
    assert_allclose([one.poses[0] for one in kept.demonstrations], 0.0, atol=1e-12)
    # Imported again as it is, it replaces a set when asked.
    again = ["set", "--out", "set", "--cutoff", "0", "--rate", "0", "--keep-rests"]
    assert imported(*again) == 2
    assert "exists; give another folder, or --overwrite" in caplog.text
    assert imported(*again, "--overwrite") == 0
    for first, second in zip(
        kept.demonstrations, load_demonstrations("set").demonstrations, strict=True
    ):
        assert_allclose(first.poses, second.poses, rtol=0, atol=1e-9)
    Path("set/import.json").unlink()  # As in a run's folder.
    assert imported(*again, "--overwrite") == 2


@pytest.mark.usefixtures("no_picture")
def test_a_folder_that_another_command_makes_meanwhile_is_not_replaced(
    files, monkeypatch, caplog
):
    prepare = importing.prepare

    def slow(*arguments: Any) -> Any:
        Path("set").mkdir()
        Path("set/demonstrations.npz").write_bytes(b"a run's")
        return prepare(*arguments)

    monkeypatch.setattr(importing, "prepare", slow)
    assert imported(*files, "--frame", "hinge", "--out", "set") == 2
    assert "set was made meanwhile; give another folder" in caplog.text
    assert Path("set/demonstrations.npz").read_bytes() == b"a run's"


def test_forces_are_imported_as_the_options_say(files):
    first, *rows = Path("0.csv").read_text().splitlines()
    forces = [f"{row},0,0,{5.0 + number % 3},0,0,0" for number, row in enumerate(rows)]
    Path("f.csv").write_text("\n".join([f"{first},fx,fy,fz,mx,my,mz", *forces]))
    said = ["--force-on", "object", "--force-axes", "recorded", "--frame", "recorded"]
    lever = ["--force-sensor", "0,0,0,1,0,0,0", "--tool-weight", "5"]
    kept = ["--cutoff", "0", "--rate", "0", "--keep-rests"]
    assert imported("0.csv", "f.csv", "--out", "set", *said, *lever, *kept) == 0
    without, shown = load_demonstrations("set").demonstrations
    assert without.wrenches is None
    expected = np.zeros(shown.poses.shape)
    # Gravity pulls the tool down: the hand applies less than is measured upwards.
    expected[:, 2] = np.arange(len(expected)) % 3
    assert_allclose(shown.wrenches, expected, atol=1e-12)
    assert "peak force [N]" in Path("set/report.txt").read_text()
    origin = json.loads(Path("set/import.json").read_text())["config"]
    assert origin["force_on"] == "object"
    rows, columns, _ = read_image("set/before_after.png").shape
    assert rows > 0.8 * columns  # With a third row of panels.


def test_a_full_disk_is_told_and_leaves_nothing(files, monkeypatch, caplog):
    before = sorted(Path().rglob("*"))

    def full(*arguments: Any, **options: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patched:
        patched.setattr("gplfd_experiments.data.importing.draw", full)
        assert imported("0.csv", "--out", "set") == 2
    (record,) = caplog.records
    assert record.getMessage() == "set: No space left on device"
    assert sorted(Path().rglob("*")) == before


ROOT = Path(__file__).parents[2]


def commands_of_the_page(name: str) -> list[list[str]]:
    page = (ROOT / "docs/your-data.md").read_text()
    marked = rf"<!-- commands: {name} -->\n```bash\n(.*?)```"
    (block,) = re.findall(marked, page, re.S)
    return [
        [
            word
            for part in shlex.split(line)[1:]
            for word in (sorted(glob.glob(part)) if "*" in part else [part])
        ]
        for line in block.splitlines()
    ]


@pytest.mark.filterwarnings("ignore:sensor noise")
@pytest.mark.usefixtures("no_picture")
def test_a_recorded_cabinet_door_opens_another_in_the_simulation(tmp_path, monkeypatch):
    monkeypatch.undo()  # in fine steps
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    for command in commands_of_the_page("cabinet door"):
        assert cli.main([*command, "--quiet"]) == 0
    kept = load_demonstrations("cabinet")
    # One door, from seven places; the hand slips by some millimetres on its handle.
    assert_allclose(np.array(kept.radii, dtype=float), 0.386, rtol=0.04)
    (result,) = json.loads(Path("opened-cabinet/metrics.json").read_text())
    assert result["success"]


@pytest.mark.usefixtures("no_picture")
def test_the_page_leads_from_recordings_to_a_robots_table(tmp_path, monkeypatch):
    page = (ROOT / "docs/your-data.md").read_text()
    (code,) = re.findall(r"<!-- python: openbox -->\n```python\n(.*?)```", page, re.S)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    for command in commands_of_the_page("openbox"):
        assert cli.main([*command, "--quiet"]) == 0
    monkeypatch.setattr("sys.argv", ["page"])
    exec(code, {})
    lines = Path("openbox.csv").read_text().splitlines()
    assert len([line for line in lines if not line.startswith("#")]) == 201
