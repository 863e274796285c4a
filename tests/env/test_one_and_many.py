"""One contract: n environments give the bits of n single ones, in Gymnasium's form.

The vector environment against Gymnasium's SyncVectorEnv of single ones. Both follow
Gymnasium's conventions independently: time limits, masks of infos, what a reset in the
same or the next step returns.
"""

import copy
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from numpy.testing import assert_array_equal

import gplfd_env
from gplfd_env.conventions.constants import GRIPPER_WIDTH

pytestmark = [pytest.mark.slow, pytest.mark.bits]

POSE, IMPEDANCE = gplfd_env.ENVIRONMENT_ID, gplfd_env.IMPEDANCE_ENVIRONMENT_ID
MOBILE, GRIPPER = gplfd_env.MOBILE_ENVIRONMENT_ID, gplfd_env.GRIPPER_ENVIRONMENT_ID
RL = gplfd_env.RL_ENVIRONMENT_ID
LEVER = {"handle": "lever", "latch": "spring", "radius": 0.53}
KNOB = {"handle": "knob", "latch": "spring", "radius": 0.45}
BARS = ["small", 0.42, {"preset": "heavy", "panel_mass": 20.0}, "large"]
DOORS = ["small", 0.42, LEVER, {"preset": "heavy", "panel_mass": 20.0}]
LIMIT = 32
EVERYTHING = {
    "push": {"along": (5.0, 9.0), "upward": 4.0, "start_time": 0.05},
    "person": {"start_time": 0.1, "duration": 0.1, "on": "hand"},
    "stop": {"angle": 0.005, "duration": 0.1},
    "bump": {"forward": (-0.01, 0.01), "duration": 0.2},
    "breakaway": {"stiction": 2.0, "seal": 1.0},
}

NONE: dict[str, Any] = {}
HARD = {"randomization": "hard"}
ALL = {"randomization": "hard", "disturbance": EVERYTHING}
DRIVES = {"base": "mobile"}
NEXT, SAME, DISABLED = AutoresetMode
CASES = [
    (POSE, NEXT, ALL),
    (POSE, NEXT, HARD | DRIVES),
    (POSE, DISABLED, ALL | DRIVES),
    (IMPEDANCE, SAME, ALL),
    (IMPEDANCE, DISABLED, HARD | DRIVES),
    (MOBILE, SAME, ALL),
    (MOBILE, DISABLED, NONE),
    (GRIPPER, NEXT, ALL),
    (GRIPPER, DISABLED, NONE | DRIVES),
    (RL, NEXT, HARD),
    (RL, DISABLED, HARD),
]


@pytest.fixture
def make_pair(opened: Callable) -> Callable[..., tuple[Any, Any]]:
    """Return a function that makes a vector environment and its model."""

    def make(
        id: str, mode: AutoresetMode = NEXT, doors: Any = DOORS, **arguments: Any
    ) -> tuple[Any, Any]:
        def single(door: Any) -> Callable[[], gym.Env]:
            return lambda: gym.make(id, door=door, **given)

        given = {"max_episode_steps": LIMIT, **arguments}
        model = SyncVectorEnv([single(door) for door in doors], autoreset_mode=mode)
        ours = gym.make_vec(id, len(doors), door=doors, autoreset_mode=mode, **given)
        return opened(ours), opened(model)

    return make


def assert_same(ours: Any, model: Any) -> None:
    """Compare what reset or step returned."""
    *ours, ours_info = ours
    *model, model_info = model
    assert data_equivalence(ours, model, exact=True)
    assert_same_info(ours_info, model_info)


def assert_same_info(ours: dict[str, Any], model: dict[str, Any]) -> None:
    """Compare masks, and values where the masks say that there are any."""
    assert ours.keys() == model.keys()
    for key, value in model.items():
        if key.startswith("_"):
            assert_array_equal(ours[key], value)
        elif isinstance(value, dict):
            assert_same_info(ours[key], value)
        else:
            mask = model[f"_{key}"]
            assert ours[key].dtype == value.dtype
            assert data_equivalence(ours[key][mask], value[mask], exact=True), key


def reset_both(ours: Any, model: Any, **given: Any) -> Any:
    # SyncVectorEnv takes the mask out of the options it is given.
    copies = ({**given, "options": dict(given.get("options", {}))} for _ in range(2))
    result = ours.reset(**next(copies))
    assert_same(result, model.reset(**next(copies)))
    return result


def drawn_actions(envs: Any, rng: np.random.Generator) -> np.ndarray:
    """Return actions that pull the first hand off its handle and spare the others."""
    space = envs.single_action_space
    actions = rng.uniform(space.low, space.high, (envs.num_envs, *space.shape))
    if envs.spec.id == RL:
        actions[:, :6] *= 0.2
        actions[0] = [1, 1, 1, 0, 0, 0]
        return actions.astype(np.float32)
    actions[:, :6] *= 0.05
    strong = [0, *range(6, *space.shape)]
    actions[0, strong] = space.high[strong]
    if space.shape == (7,):
        actions[0, 6] = 0.0  # Fingers that open lose nothing.
    return actions


@pytest.mark.parametrize(("id", "mode", "circumstances"), CASES)
def test_numbers_are_those_of_single_environments(id, mode, circumstances, make_pair):
    ours, model = make_pair(id, mode, **circumstances)
    reset_both(ours, model, seed=5)
    rng = np.random.default_rng(1)
    alone = together = 0
    for _ in range(2 * LIMIT + 5 if mode is NEXT else LIMIT + 10):
        actions = drawn_actions(ours, rng)
        result = ours.step(actions)
        assert_same(result, model.step(actions))
        ended = result[2] | result[3]
        alone += 0 < ended.sum() < len(DOORS)
        together += ended.sum() > 1
        if mode is DISABLED and ended.any():
            reset_both(ours, model, options={"reset_mask": ended})
    assert alone > 0, "some must be reset while others go on"
    assert together > 0, "some must reach the time limit"
    if "randomization" in circumstances:
        assert len({one.delay for one in ours.unwrapped.variations}) > 1


@pytest.mark.parametrize("id", [POSE, GRIPPER])
def test_hands_reach_for_their_handles_and_take_them(id, make_pair):
    """Each believes its handle to be somewhat beside where it is."""
    ranges = {"preset": "mild", "perception": (0.002, 0.01)}
    begin = {"base": "mobile", "start": "approach", "randomization": ranges}
    doors = ["room-834", "small"]
    ours, model = make_pair(id, NEXT, doors, **begin, max_episode_steps=300)
    observations, _ = reset_both(ours, model, seed=4)
    start = observations["ee_pose"].copy()
    for step in range(290):
        actions = start * (1.0 - min(step / 110, 1.0))
        if id == GRIPPER:
            width = GRIPPER_WIDTH if step < 110 else 0.0
            actions = np.column_stack([actions, np.full(2, width)])
        result = ours.step(actions)
        assert_same(result, model.step(actions))
    assert result[-1]["grasped"].all()


def test_each_simulation_may_have_circumstances_of_its_own(make_vec, make_env):
    randomizations = ["hard", {"longest_delay": 3}, "none"]
    disturbances = [{"push": {"along": (4.0, 9.0)}}, "none", EVERYTHING]
    doors = ["small", LEVER, KNOB]
    names = ("door", "randomization", "disturbance")
    columns = (doors, randomizations, disturbances)
    ours = make_vec(3, **dict(zip(names, columns, strict=True)))
    rows = zip(*columns, strict=True)
    singles = [make_env(**dict(zip(names, row, strict=True))) for row in rows]
    rng = np.random.default_rng(0)
    for shift in range(2):
        turned = doors[shift:] + doors[:shift]
        together, _ = ours.reset(seed=7, options={"door": turned})
        alone = [
            single.reset(seed=7 + row, options={"door": turned[row]})[0]
            for row, single in enumerate(singles)
        ]
        for _ in range(25):
            for row, observation in enumerate(alone):
                for key, value in observation.items():
                    assert_array_equal(together[key][row], value)
            actions = 0.03 * rng.uniform(-1.0, 1.0, (3, 6))
            together, *_ = ours.step(actions)
            alone = [
                one.step(action)[0]
                for one, action in zip(singles, actions, strict=True)
            ]
    ours.reset(
        seed=1, options={"disturbance": "bump", "reset_mask": np.array([0, 1, 0], bool)}
    )
    kinds = [one.disturbance.bump is not None for one in ours.variations]
    assert kinds == [False, True, True]


@pytest.mark.usefixtures("scratch_folder")
@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("value", [1e8, np.nan])
def test_a_diverged_simulation_ends_alone_and_starts_anew(value, mode, make_pair):
    """Twice in a row: what MuJoCo counts must not be taken for another divergence."""
    ours, model = make_pair(POSE, mode, BARS)
    reset_both(ours, model, seed=0)
    rng = np.random.default_rng(2)
    ends = []
    for step in range(12):
        if step in (3, 7):
            batch = ours._batch
            batch._batches[batch._structure[1]].qpos[1] = value
            model.envs[1].unwrapped.data.qpos[:] = value
        actions = 0.02 * drawn_actions(ours, rng)
        result = ours.step(actions)
        assert_same(result, model.step(actions))
        ends.append(result[3].tolist())
        if mode is DISABLED and result[3].any():
            later = copy.deepcopy(ours).step(actions)[0]
            assert later["time"][1] == result[0]["time"][1], "it stands still"
            reset_both(ours, model, options={"reset_mask": result[3]})
    alone = [False, True, False, False]
    assert ends == [alone if step in (3, 7) else 4 * [False] for step in range(12)]


def test_any_number_of_threads_gives_the_same_numbers(make_vec):
    results = []
    for threads in (1, 2, 3, 0):
        envs = make_vec(13, id=IMPEDANCE, randomization="hard", num_threads=threads)
        rng = np.random.default_rng(0)
        seen = [envs.reset(seed=0)]
        for _ in range(12):
            actions = rng.uniform(envs.action_space.low, envs.action_space.high)
            seen.append(envs.step(0.3 * actions))
        results.append(seen)
    for other in results[1:]:
        assert data_equivalence(results[0], other, exact=True)
