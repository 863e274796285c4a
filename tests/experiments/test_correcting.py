"""The synthetic corrector, practice, `gplfd correct`, and the trial of corrections."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from gplfd_env import DoorConfig, DoorGeometry
from gplfd_env.doors.config import DOORS
from gplfd_experiments.analysis.results.reading import read_results
from gplfd_experiments.analysis.results.trials import trial_answers
from gplfd_experiments.cli import main as cli
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.episodes.leading import LedAgent, SyntheticCorrector
from gplfd_policies import load_skill
from gplfd_policies.agents.agent import as_agent
from gplfd_policies.control.steps import AgentStep
from gplfd_policies.demonstrations.npz import save_demonstrations

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore:sensor noise")]

DOOR = DoorGeometry.of(DoorConfig(radius=0.5))


def creep(time: float) -> float:
    """A door that hardly moves."""
    return 1e-5 * time


class Held:
    """An agent that commands one pose on or beside the path."""

    def __init__(self, pose: np.ndarray) -> None:
        self.pose = pose

    def act(self, observation: dict[str, np.ndarray]) -> AgentStep:
        return AgentStep(action=self.pose, observed_phase=0.25)


def watched(pose: np.ndarray, seconds: float, angle=lambda time: 0.0, seed=0):
    """Commands of a led agent while the door is where it is said to be."""
    agent = LedAgent(
        as_agent(Held(pose)), SyntheticCorrector(np.random.default_rng(seed))
    )
    agent.inform(DOOR)
    agent.reset({"ee_pose": np.zeros(6)})
    commands = []
    for time in np.arange(0.0, seconds, 0.01):
        hand = DOOR.hand_poses(angle(time))
        seen = {"time": np.array([time]), "ee_pose": hand, "wrench": np.ones(6)}
        commands.append(agent.act(seen).action)
    return np.array(commands), agent.correction(door="medium", seed=3)


@pytest.mark.parametrize(("beside", "begins"), [(0.0, 3.0), (0.03, 0.0)])
def test_a_hand_that_stalls_or_leaves_the_path_is_led_smoothly(beside, begins):
    """Towards a point of the path whose distance the force along it limits."""
    pose = DOOR.hand_poses(0.01)
    pose[1] += beside
    commands, correction = watched(pose, begins + 1.4, creep)
    led = correction.led
    first = int(led.argmax())
    assert 0.01 * first == pytest.approx(begins, abs=0.02)
    assert led[first:].all()
    assert correction.phase == 0.25
    assert correction.by == "synthetic"
    assert np.all(correction.motion.wrenches == -1.0)
    # No jump where the hand is taken, and then 34 N of a servo of 2000 N/m.
    assert np.abs(commands[first + 1] - commands[first])[:3].max() < 1e-3
    pull = commands[-1, :3]
    assert pull[0] == pytest.approx(0.017, abs=0.004)
    assert np.abs(pull[1:]).max() < 0.005
    again, _ = watched(pose, begins + 1.4, creep)
    np.testing.assert_array_equal(again, commands)
    other, _ = watched(pose, begins + 1.4, creep, seed=1)
    assert np.abs(other - commands).max() > 1e-4


def test_the_hand_is_handed_over_when_the_policy_agrees_again():
    commands, correction = watched(
        DOOR.hand_poses(0.02), 7.0, angle=lambda time: 0.0 if time < 3.2 else 0.001
    )
    led = correction.led
    assert led.sum() == pytest.approx(100 * (1.5 + 0.4), abs=3)
    np.testing.assert_allclose(commands[led][-1], commands[0], atol=1e-9)
    assert watched(DOOR.hand_poses(0.02), 4.0, lambda time: 0.1 * time)[1] is None
    agent = Held(np.zeros(6))
    agent.control = "impedance"
    with pytest.raises(ValueError, match="commands the arm's stiffness, too"):
        LedAgent(agent, SyntheticCorrector(np.random.default_rng(0)))


def test_one_correction_lets_a_skill_open_the_door_at_which_it_stalled(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    door = {"preset": "oven", "radius": 0.36, "closer": {"preload": 4.5}}
    Path("flap.json").write_text(json.dumps(door))
    shown = Teacher().standard_demonstrations(seed=0, like=DOORS["oven"])
    save_demonstrations("demos.npz", shown)
    learn = ["learn", "demos.npz", "--quiet", "--out"]
    assert cli.main([*learn, "skill.npz"]) == 0
    capsys.readouterr()
    correct = ["correct", "skill.npz", "--quiet", "--doors"]
    assert cli.main([*correct, "flap.json"]) == 0
    said = capsys.readouterr().out
    assert "flap  led for" in said
    assert said.split("\n")[1].endswith("opened alone")
    assert "gplfd run --skill skill-corrected.npz --doors flap.json\n" in said
    better = load_skill("skill-corrected.npz")
    (kept,) = better.corrections
    assert (kept.door, kept.seed, kept.by, better.count) == ("flap", 0, "synthetic", 7)
    before = Path("skill-corrected.npz").read_bytes()
    for words in ([*correct, "flap.json"], [*learn, "skill-corrected.npz"]):
        assert cli.main(words) == 2
        assert "corrections; give" in capsys.readouterr().err
    assert Path("skill-corrected.npz").read_bytes() == before
    assert cli.main([*correct, "medium", "--policy", "promp"]) == 2
    Path("skill-corrected.npz").rename("better.npz")
    unled = SimpleNamespace(failure="", reason=""), None
    monkeypatch.setattr(f"{LedAgent.__module__}.corrected", lambda *_: unled)
    assert cli.main(["correct", "better.npz", "--quiet", "--doors", "flap.json"]) == 0
    assert "nothing was corrected, and nothing written" in capsys.readouterr().out
    assert not Path("better-corrected.npz").exists()


def test_doors_that_corrections_gain_and_forget_are_counted(
    write_study, episode_result, page_of
):
    opened = {
        "overhead, 0": (True, True, False, False),
        "overhead, 1": (True, False, True, True),
    }
    results = []
    for level, found in opened.items():
        for seed in range(3):
            for radius, good in zip((0.33, 0.36, 0.39, 0.42), found, strict=True):
                place = {"trial": "corrections", "level": level, "radius": radius}
                result = episode_result("gp", seed, **place)
                result["metrics"]["success"] = good
                results.append(result)
    results.append(episode_result("promp", 0, trial="corrections", level="overhead, 0"))
    answers = trial_answers(read_results(write_study(results)))["contrasts"]
    one = next(each for each in answers if each["with"] == "gp, overhead, 1")
    assert (one["gained"], one["forgotten"], one["opened before"]) == (6, 3, 6)
    page = page_of(results)
    assert "doors: 6 gained, 3 forgotten, 6 opened before" in page
    assert "Cannot be corrected: `promp`." in page
