"""What an environment says, in other forms."""

import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

import gplfd_env
from gplfd_env.wrappers import FAILURES, REASONS, NumericInfo, VectorNumericInfo

PAGE = Path(__file__).parents[2] / "docs" / "environment.md"
AWAY = np.array([0.6, 0.0, 0.0, 0.0, 0.0, 0.0])
"""So fast that the hand loses the handle."""


def leaves(value: Any) -> Iterator[Any]:
    if isinstance(value, Mapping):
        for inner in value.values():
            yield from leaves(inner)
    else:
        yield value


def steps_to_the_end(env: Any, action: Any) -> list[Any]:
    outcomes = [env.step(action)]
    while not np.all(outcomes[-1][2] | outcomes[-1][3]):
        outcomes.append(env.step(action))
    return outcomes


def test_codes_are_those_of_the_page() -> None:
    (row,) = re.findall(r"^\| `failure` \| str .*$", PAGE.read_text(), re.MULTILINE)
    assert re.findall(r'`"(\w*)"`', row) == list(FAILURES)


def test_an_info_holds_numbers_only(make_env: Callable) -> None:
    plain, coded = make_env("small"), NumericInfo(make_env("small"))
    assert plain.reset(seed=0)[1]["failure"] == ""
    _, info = coded.reset(seed=0)
    assert info["failure_code"] == 0
    before = steps_to_the_end(plain, AWAY)[-1][4]
    after = steps_to_the_end(coded, AWAY)[-1][4]
    assert FAILURES[after["failure_code"]] == before["failure"] == "grasp_lost"
    assert all(not isinstance(leaf, str) for leaf in leaves(after))
    assert REASONS[after["reason_code"]] == before["reason"]
    assert after["stage_code"] == before["capability"]
    for name in ("failure", "reason", "stage"):
        del before[name], after[f"{name}_code"]
    assert data_equivalence(before, after, exact=True)


@pytest.mark.parametrize("mode", ["NextStep", "Disabled"])
def test_vectorised_infos_can_become_tensors(make_vec: Callable, mode: str) -> None:
    """Other libraries take arrays over by DLPack, as Gymnasium's NumpyToTorch does."""
    plain = make_vec(2, autoreset_mode=mode)
    coded = VectorNumericInfo(make_vec(2, autoreset_mode=mode))
    _, infos = plain.reset(seed=0)
    with pytest.raises(BufferError):
        np.from_dlpack(infos["failure"])
    _, infos = coded.reset(seed=0)
    actions = np.stack([AWAY, 0.0 * AWAY])
    said = []
    for _ in range(60):
        for leaf in leaves(infos):
            np.from_dlpack(leaf)
        *_, expected = plain.step(actions)
        *_, infos = coded.step(actions)
        said.append(infos["failure_code"].tolist())
        assert [FAILURES[code] for code in said[-1]] == expected["failure"].tolist()
        assert infos["_failure_code"].tolist() == expected["_failure"].tolist()
    assert [1, 0] in said


def test_the_info_of_an_ended_episode_has_a_code_too(make_vec: Callable) -> None:
    envs = VectorNumericInfo(make_vec(2, autoreset_mode="SameStep"))
    envs.reset(seed=0)
    actions = np.stack([AWAY, 0.0 * AWAY])
    for _ in range(60):
        *_, terminations, _, infos = envs.step(actions)
        if terminations.any():
            break
    assert infos["final_info"]["failure_code"].tolist() == [1, 0]
    assert infos["failure_code"].tolist() == [0, 0]


def test_a_failure_without_a_code_is_named(make_env: Callable) -> None:
    class Odd(gym.Wrapper[Any, Any, Any, Any]):
        def reset(self, **_: Any) -> Any:
            return None, {"failure": "melted"}

    with pytest.raises(ValueError, match="failure 'melted' has no code; known are"):
        NumericInfo(Odd(make_env())).reset()


def test_the_number_of_steps_stands_beside_the_time() -> None:
    """Gymnasium's own name for it is that of the environment's seconds."""
    env = gym.make(gplfd_env.ENVIRONMENT_ID)
    with pytest.raises(ValueError, match=r"dict_time_key.*already exists"):
        gym.wrappers.TimeAwareObservation(env, flatten=False)
    timed = gym.wrappers.TimeAwareObservation(env, flatten=False, dict_time_key="step")
    timed.reset(seed=0)
    observation, *_ = timed.step(np.zeros(6))
    assert (observation["step"], observation["time"]) == (1, pytest.approx(0.01))
    assert observation in timed.observation_space
    env.close()
