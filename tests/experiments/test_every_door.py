"""Every command opens a door of every kind, from either start, alone and together."""

import itertools
import json

import numpy as np
import pytest

from gplfd_env.doors.config import DOORS
from gplfd_experiments.analysis.results.reading import read_results
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_policies.demonstrations.npz import load_demonstrations

pytestmark = pytest.mark.slow

PUSHED = {"radius": 0.7, "handle": "knob", "latch": "spring", "swing": "push"}
KINDS = {(*door.kind.values(), door.radius > 0.65): key for key, door in DOORS.items()}
"""The last preset of every kind of door and robot."""


@pytest.fixture(autouse=True)
def pushed(tmp_path):
    """Write a door as a person may give it."""
    (tmp_path / "pushed.json").write_text(json.dumps(PUSHED))


@pytest.mark.parametrize(
    ("door", "start"),
    [*zip([*KINDS.values(), "pushed.json"], itertools.cycle(["approach", "grasped"]))],
)
def test_run_opens_it(gplfd, tmp_path, door, start):
    out = tmp_path / "run"
    given = ("--doors", door, "--start", start, "--policy", "oracle")
    assert gplfd("run", *given, "--out", str(out)) == 0
    (metrics,) = json.loads((out / "metrics.json").read_text())
    assert metrics["success"], metrics
    assert (out / f"{metrics['door']}.rrd").stat().st_size > 0


@pytest.mark.filterwarnings("ignore:rests")
def test_a_run_of_several_kinds_learns_each_from_its_own(gplfd, tmp_path, request):
    doors = ("small", "room-584")
    out = tmp_path / "run"
    assert gplfd("run", "--policy", "promp", "--doors", *doors, "--out", "run") == 0
    metrics = json.loads((out / "metrics.json").read_text())
    assert [(one["door"], one["success"]) for one in metrics] == [
        (door, True) for door in doors
    ]
    bars = load_demonstrations(out / "demonstrations-small.npz")
    levers = load_demonstrations(out / "demonstrations-room-584.npz")
    assert bars.radii == (0.35, 0.35, 0.50, 0.50, 0.65, 0.65)
    assert levers.radii == (0.53, 0.53, 0.65, 0.65, 0.78, 0.78)
    together = EpisodeLog.load(out / "room-584.npz")
    # Alone or beside doors of another kind, an episode is the same.
    request.getfixturevalue("short_episodes")
    given = ("--policy", "promp", "--doors", "room-584")
    assert gplfd("run", *given, "--out", "alone") == 0
    alone = EpisodeLog.load(tmp_path / "alone" / "room-584.npz").motion.ee_pose
    assert len(alone) > 100
    np.testing.assert_array_equal(alone, together.motion.ee_pose[: len(alone)])


@pytest.mark.usefixtures("small_plots")
def test_a_study_of_doors_of_several_kinds_can_be_read(gplfd, tmp_path, capsys):
    given = ("--doors", "room-834", "pushed.json", "--start", "approach")
    where = ("--engine", "serial", "--quiet", "--out", "study")
    study = ("--policies", "oracle", "--seeds", "1", "--no-skill")
    assert gplfd("benchmark", *given, *study, *where) == 0
    found = read_results(tmp_path / "study")
    assert not found.unreadable
    assert {one.task.door for one in found.episodes if one.solved} == {
        *("room-834", "pushed")
    }
    assert "room-834" in capsys.readouterr().out
