"""Demonstrations of several kinds without a label, in runs."""

from pathlib import Path

import numpy as np
import pytest

from gplfd_env.doors.config import DoorConfig
from gplfd_experiments.data.teacher import MESSY, ROOM_RADII, TIDY, Teacher, doors_like
from gplfd_experiments.episodes.build import (
    demonstrations_of,
    learned_agents,
    open_together,
)
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.episodes.task import EpisodeTask, episode_task
from gplfd_policies import POLICIES, align
from gplfd_policies.demonstrations.aligned import partition
from gplfd_policies.demonstrations.npz import load_demonstrations, save_demonstrations

pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings(
        "ignore:rests", "ignore:sensor noise", "ignore:3 demonstrations"
    ),
]

RECORDINGS = Path(__file__).parents[2] / "examples/recordings"
LEVER = {"handle": "lever", "latch": "spring"}


def two_kinds(door: DoorConfig, first: str, second: str) -> EpisodeTask:
    """A task whose demonstrations are pulled or pushed, three doors of each."""
    radii = [one.radius for one in doors_like(door)]
    return episode_task(
        "door",
        door,
        policy="gp",
        seed=0,
        demonstrations_per_door=1,
        demonstrated_radii=(*radii, *radii),
        demonstrated_hardware=tuple(
            {"swing": swing} for swing in (first, second) for _ in radii
        ),
    )


@pytest.mark.parametrize("kind", [{}, {"swing": "push"}, LEVER, {"hinge_side": "left"}])
@pytest.mark.parametrize("habits", [TIDY, MESSY])
def test_demonstrations_of_one_kind_are_one_mode(kind, habits):
    for seed in range(3):
        rng = np.random.default_rng(seed)
        doors = doors_like(DoorConfig(**kind))
        shown = Teacher(habits=habits).demonstrate_doors(doors, 2, rng=rng)
        assert partition(align(shown)) == (tuple(range(6)),)
        assert partition(align([shown[0], shown[-1]])) == ((0, 1),)


@pytest.mark.usefixtures("coarse_cuts", "no_picture", "reads_here")
def test_recordings_of_one_motion_are_one_mode(gplfd):
    for name, rate, frame in (
        ("openbox", 20, "first-pose"),
        ("cabinet_door", 30, "hinge"),
    ):
        files = sorted(map(str, (RECORDINGS / name).glob("*.csv")))[::2]
        more = ("--recorded-rate", str(rate), "--frame", frame, "--out", name)
        assert gplfd("demos", "import", *files, *more) == 0
        given = load_demonstrations(Path(name)).demonstrations
        assert partition(align(given)) == (tuple(range(len(files))),)


@pytest.mark.parametrize(
    ("door", "first", "limit"),
    [
        (DoorConfig(radius=0.42, swing="push"), "pull", 20.0),
        (DoorConfig(radius=ROOM_RADII[1], **LEVER), "push", 50.0),
    ],
)
def test_the_other_kind_is_tried_after_a_bounded_force(door, first, limit):
    task = two_kinds(door, first, door.swing)
    make = learned_agents(task, POLICIES["gp"])
    (log,) = open_together([task], [make()])
    assert log.success
    assert list(log.decisions.mode[[0, -1]]) == [0.0, 1.0]
    assert np.count_nonzero(np.diff(log.decisions.mode)) == 1
    assert log.decisions.mode_probability[0] == pytest.approx(0.5, abs=0.01)
    assert log.decisions.mode_probability[-1] > 0.99
    assert episode_metrics(log)["force_handle_peak"] < limit


def test_a_skill_is_of_one_kind(gplfd, capsys):
    task = two_kinds(DoorConfig(), "pull", "push")
    save_demonstrations("both.npz", demonstrations_of(task).demonstrations)
    assert gplfd("learn", "both.npz", "--out", "skill.npz") == 2
    assert "2 kinds of motion, but a skill is one: demonstrations 0, 1, 2; 3, 4, 5" in (
        " ".join(capsys.readouterr().err.split())
    )
    assert not Path("skill.npz").exists()
