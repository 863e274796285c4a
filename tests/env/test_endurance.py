"""Many random steps and many random doors; more of them when run as a script:

python tests/env/test_endurance.py endure 100000
python tests/env/test_endurance.py digest 200
"""

import hashlib
import subprocess
import sys
import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import gplfd_env
from gplfd_env.config import DoorConfig

IDS = (gplfd_env.ENVIRONMENT_ID, gplfd_env.IMPEDANCE_ENVIRONMENT_ID)
N = 8


def endure(id: str, randomization: str, steps: int) -> dict[str, int]:
    """Step random doors with random actions; return how many episodes ended how.

    Half of the simulations get actions from the whole space, which soon tear the hand
    off; the others small ones, which they survive.
    """
    envs = gym.make_vec(id, N, randomization=randomization, autoreset_mode="SameStep")
    rng = np.random.default_rng(0)
    low, high = envs.single_action_space.low, envs.single_action_space.high
    outcomes = {"grasp_lost": 0, "stalled": 0, "simulation_error": 0, "": 0}
    observations, _ = envs.reset(seed=0)
    for _ in range(-(-steps // N)):
        actions = rng.uniform(low, high, (N, len(low)))
        actions[N // 2 :, :6] *= 0.03
        observations, rewards, terminations, truncations, infos = envs.step(actions)
        assert observations in envs.observation_space
        assert np.isfinite(rewards).all()
        for key, value in infos.items():
            if isinstance(value, np.ndarray) and value.dtype == np.float64:
                assert np.isfinite(value).all(), key
        for row in np.flatnonzero(terminations | truncations):
            outcomes[infos["final_info"]["failure"][row]] += 1
    envs.close()
    return outcomes


def digest(pair: int) -> str:
    """Return a hash of everything that a random door with a random seed gives."""
    rng = np.random.default_rng(pair)
    door = DoorConfig(radius=rng.uniform(0.30, 0.65), panel_mass=rng.uniform(1.0, 50.0))
    seed = int(rng.integers(2**31))
    env: Any = gym.make(
        IDS[pair % 2], door=door, randomization=("none", "hard")[pair % 3 > 0]
    )
    results = [env.reset(seed=seed)]
    for _ in range(25):
        results.append(
            env.step(rng.uniform(0.2 * env.action_space.low, env.action_space.high))
        )
    env.close()
    return hashlib.sha256(repr(_exact(results)).encode()).hexdigest()


def _exact(value: Any) -> Any:
    """Return nested results with arrays as bytes and floats in hexadecimal."""
    if isinstance(value, dict):
        return {key: _exact(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_exact(item) for item in value]
    if isinstance(value, np.ndarray):
        return value.tobytes()
    return value.hex() if isinstance(value, float) else value


@pytest.mark.parametrize("randomization", ["mild", "hard"])
@pytest.mark.parametrize("id", IDS)
def test_random_actions_before_random_doors(id: str, randomization: str) -> None:
    """No exception, no warning, no NaN, nothing outside its space, no divergence."""
    outcomes = endure(id, randomization, 1600)
    assert outcomes["grasp_lost"] > 5
    assert outcomes["simulation_error"] == 0


def test_two_processes_agree_bit_for_bit() -> None:
    pairs = 6
    result = subprocess.run(
        [sys.executable, __file__, "digest", str(pairs)],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    assert result.stdout.split() == [digest(pair) for pair in range(pairs)]
    assert len(set(result.stdout.split())) == pairs


if __name__ == "__main__":
    what, number = sys.argv[1], int(sys.argv[2])
    warnings.simplefilter("error")
    if what == "digest":
        print("\n".join(digest(pair) for pair in range(number)))
    else:
        for id in IDS:
            for randomization in ("mild", "hard"):
                print(id, randomization, endure(id, randomization, number // 4))
