"""One contract: n environments give the bits of n single ones, in Gymnasium's form.

The vector environment against Gymnasium's SyncVectorEnv of single ones; its episodes
count with Python's floats, as those of a few do, and with arrays, as those of many.

Both follow Gymnasium's conventions independently: time limits, masks of infos, what a
reset in the same or the next step returns.
"""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from numpy.testing import assert_array_equal

import gplfd_env

pytestmark = [pytest.mark.slow, pytest.mark.bits]

POSE, GRIPPER = gplfd_env.ENVIRONMENT_ID, gplfd_env.GRIPPER_ENVIRONMENT_ID
IMPEDANCE, MOBILE = (
    gplfd_env.IMPEDANCE_ENVIRONMENT_ID,
    gplfd_env.MOBILE_ENVIRONMENT_ID,
)
DOORS = ["small", 0.42, {"preset": "heavy", "panel_mass": 20.0}, "large"]
LIMIT = 45
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
NEXT, SAME, DISABLED = (
    AutoresetMode.NEXT_STEP,
    AutoresetMode.SAME_STEP,
    AutoresetMode.DISABLED,
)
CASES = [
    (POSE, NEXT, ALL, "arrays"),
    (POSE, NEXT, HARD | DRIVES, "floats"),
    (POSE, SAME, HARD, "floats"),
    (POSE, SAME, NONE, "arrays"),
    (POSE, DISABLED, NONE, "floats"),
    (POSE, DISABLED, ALL | DRIVES, "arrays"),
    (IMPEDANCE, NEXT, HARD, "arrays"),
    (IMPEDANCE, SAME, ALL, "floats"),
    (IMPEDANCE, DISABLED, HARD | DRIVES, "arrays"),
    (MOBILE, NEXT, HARD, "arrays"),
    (MOBILE, SAME, ALL, "arrays"),
    (MOBILE, DISABLED, NONE, "floats"),
    (GRIPPER, NEXT, ALL, "floats"),
    (GRIPPER, SAME, HARD, "arrays"),
    (GRIPPER, DISABLED, NONE | DRIVES, "arrays"),
]


@pytest.fixture
def count_as(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Return a function: a few simulations are counted as floats or as arrays."""
    return lambda numbers: monkeypatch.setattr(
        "gplfd_env.task.episodes.MANY", 2 if numbers == "arrays" else 100
    )


@pytest.fixture
def make_pair(make_vec: Callable) -> Any:
    """Return a function that makes a vector environment and its model."""
    opened = []

    def make(
        id: str, mode: AutoresetMode = AutoresetMode.NEXT_STEP, **arguments: Any
    ) -> tuple[Any, Any]:
        def single(door: Any) -> Callable[[], gym.Env]:
            return lambda: gym.make(id, door=door, max_episode_steps=LIMIT, **arguments)

        model = SyncVectorEnv([single(door) for door in DOORS], autoreset_mode=mode)
        opened.append(model)
        ours = make_vec(
            len(DOORS),
            id=id,
            door=DOORS,
            autoreset_mode=mode,
            max_episode_steps=LIMIT,
            **arguments,
        )
        return ours, model

    yield make
    for model in opened:
        model.close()


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


def reset_both(ours: Any, model: Any, rows: np.ndarray) -> None:
    # SyncVectorEnv takes the mask out of the options it is given.
    masks = ({"reset_mask": rows.copy()} for _ in range(2))
    assert_same(ours.reset(options=next(masks)), model.reset(options=next(masks)))


def drawn_actions(envs: Any, rng: np.random.Generator) -> np.ndarray:
    """Return actions that pull the first hand off its handle and spare the others."""
    space = envs.single_action_space
    actions = rng.uniform(space.low, space.high, (len(DOORS), *space.shape))
    actions[:, :6] *= 0.05
    actions[0, [0, *range(6, *space.shape)]] = space.high[[0, *range(6, *space.shape)]]
    if space.shape == (7,):
        actions[0, 6] = 0.0  # Fingers that open lose nothing.
    return actions


@pytest.mark.parametrize(("id", "mode", "circumstances", "numbers"), CASES)
def test_every_number_is_that_of_single_environments(
    id: str,
    mode: AutoresetMode,
    circumstances: dict[str, Any],
    numbers: str,
    make_pair: Callable,
    count_as: Callable,
) -> None:
    count_as(numbers)
    ours, model = make_pair(id, mode, **circumstances)
    assert_same(ours.reset(seed=5), model.reset(seed=5))
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
            reset_both(ours, model, ended)
    assert alone > 0, "some must be reset while others go on"
    assert together > 0, "some must reach the time limit"
    if "randomization" in circumstances:
        assert len({one.delay for one in ours.variations}) > 1


def test_each_simulation_may_have_circumstances_of_its_own(
    make_vec: Callable,
) -> None:
    randomizations = ["hard", {"longest_delay": 3}, "none"]
    disturbances = [{"push": {"along": (4.0, 9.0)}}, "none", EVERYTHING]
    ours = make_vec(3, randomization=randomizations, disturbance=disturbances)
    singles = [
        gym.make(POSE, randomization=one, disturbance=other)
        for one, other in zip(randomizations, disturbances, strict=True)
    ]
    starts = [single.reset(seed=7 + row)[0] for row, single in enumerate(singles)]
    together, _ = ours.reset(seed=7)
    rng = np.random.default_rng(0)
    for _ in range(40):
        for row, start in enumerate(starts):
            for key, value in start.items():
                assert_array_equal(together[key][row], value)
        actions = 0.03 * rng.uniform(-1.0, 1.0, (3, 6))
        together, *_ = ours.step(actions)
        starts = [
            one.step(action)[0] for one, action in zip(singles, actions, strict=True)
        ]
    changed = ours.reset(
        seed=1, options={"disturbance": "bump", "reset_mask": np.array([0, 1, 0], bool)}
    )
    assert changed[1]["_slip"].tolist() == [False, True, False]
    kinds = [one.disturbance.bump is not None for one in ours.variations]
    assert kinds == [False, True, True]
    with pytest.raises(ValueError, match="randomization must be one for all simul"):
        ours.reset(options={"randomization": ["hard"]})
    for single in singles:
        single.close()


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize(("value", "numbers"), [(1e8, "arrays"), (np.nan, "floats")])
def test_a_diverged_simulation_ends_alone_and_starts_anew(
    value: float,
    numbers: str,
    mode: AutoresetMode,
    count_as: Callable,
    make_pair: Callable,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Any,
) -> None:
    """Twice in a row: what MuJoCo counts must not be taken for another divergence."""
    monkeypatch.chdir(tmp_path)  # MuJoCo writes MUJOCO_LOG.TXT there
    count_as(numbers)
    ours, model = make_pair(POSE, mode)
    assert_same(ours.reset(seed=0), model.reset(seed=0))
    rng = np.random.default_rng(2)
    ends = []
    for step in range(12):
        if step in (3, 7):
            ours._batch.qpos_of(1)[:] = value
            model.envs[1].unwrapped.data.qpos[:] = value
        actions = 0.02 * drawn_actions(ours, rng)
        result = ours.step(actions)
        assert_same(result, model.step(actions))
        ends.append(result[3].tolist())
        if mode is DISABLED and result[3].any():
            reset_both(ours, model, result[3])
    alone = [False, True, False, False]
    assert ends == [alone if step in (3, 7) else 4 * [False] for step in range(12)]


def test_a_second_reset_continues_the_generators(make_pair: Callable) -> None:
    ours, model = make_pair(POSE, randomization="mild")
    assert_same(ours.reset(seed=[8, 3, 99, 3]), model.reset(seed=[8, 3, 99, 3]))
    assert_same(ours.reset(), model.reset())
    assert ours.np_random_seed == model.np_random_seed == (8, 3, 99, 3)
    for one, other in zip(ours.np_random, model.np_random, strict=True):
        assert one.bit_generator.state == other.bit_generator.state


def test_options_reach_every_simulation(make_pair: Callable) -> None:
    ours, model = make_pair(POSE)
    options = {"door": {"radius": 0.45, "hinge_friction": 3.0}, "randomization": "mild"}
    assert_same(
        ours.reset(seed=1, options=options), model.reset(seed=1, options=dict(options))
    )
    assert list(options) == ["door", "randomization"], "the caller's own is kept"
    assert_same(ours.reset(), model.reset())


def test_any_number_of_threads_gives_the_same_numbers(make_vec: Callable) -> None:
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
