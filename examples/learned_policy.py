"""PPO on `gplfd/DoorOpeningRL-v1`, evaluated like the policies; needs the extra sb3.

    python examples/learned_policy.py --steps 700000 --out results/ppo
    gplfd benchmark --config small --policies gp examples/learned_policy.py:make

The first command learns and writes `results/ppo/model.zip`. The second reads the model
from there, or from the folder that the environment variable GPLFD_LEARNED names.

Exploration is decisive, because the reward penalises the greatest force so far.
Decisions are made at 10 Hz and held. The exploration noise is a function of the
observation, drawn once per rollout (gSDE, Raffin et al. 2022): noise that changes
between decisions causes force, but does not move the door.
"""

import os
from pathlib import Path

import numpy as np
import torch
import tyro
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnvWrapper, VecMonitor, VecNormalize

from gplfd_env.wrappers import command_of, flat_of
from gplfd_env.wrappers.sb3 import make_sb3

FOLDER = Path(os.environ.get("GPLFD_LEARNED", "results/ppo"))
RADII = [0.30, 0.35, 0.40, 0.45, 0.50, 0.55, 0.60, 0.65]  # [m]
HELD = 10  # control periods


class HeldActions(VecEnvWrapper):
    """Holds every action for `HELD` control periods and sums the rewards.

    A simulation whose episode ends meanwhile waits in the next one for the others.
    """

    def reset(self):
        return self.venv.reset()

    def step_async(self, actions):
        self.actions = actions.copy()

    def step_wait(self):
        total = np.zeros(self.num_envs, np.float32)
        ended = np.zeros(self.num_envs, bool)
        infos = [{} for _ in ended]
        for _ in range(HELD):
            observations, rewards, dones, latest = self.venv.step(self.actions)
            total[~ended] += rewards[~ended]
            # The info of the step in which an episode ended is kept.
            infos = [infos[n] if over else latest[n] for n, over in enumerate(ended)]
            ended |= dones
            self.actions[ended] = 0.0
        return observations, total, ended, infos


class Learned:
    """An agent: the mean action of the network for the observation, as a pose."""

    def __init__(self, model, normal):
        self.model, self.normal = model, normal

    def reset(self, observation):
        self.steps = 0

    def act(self, observation):
        if self.steps % HELD == 0:
            scaled = self.normal.normalize_obs(flat_of(observation))
            self.action, _ = self.model.predict(scaled, deterministic=True)
        self.steps += 1
        return command_of(self.action, observation["ee_pose"])


def learn(steps: int = 700_000, out: Path = FOLDER, seed: int = 0):
    """Learn, and write the model into a folder."""
    torch.set_num_threads(1)
    out.mkdir(parents=True, exist_ok=True)
    envs = make_sb3(2 * len(RADII), door=2 * RADII)
    normal = VecNormalize(VecMonitor(HeldActions(envs)))
    model = PPO(
        "MlpPolicy",
        normal,
        n_steps=64,
        batch_size=256,
        target_kl=0.03,
        use_sde=True,
        seed=seed,
        verbose=1,
        learning_rate=lambda left: 1e-3 * left,
        policy_kwargs={"log_std_init": -4.5, "net_arch": [64, 64]},
    )
    model.learn(steps // HELD)
    model.save(out / "model.zip")
    normal.save(str(out / "normal.pkl"))


def make(training):
    """The policy that PPO learned, from its folder."""
    envs = make_sb3(1)
    normal = VecNormalize.load(str(FOLDER / "normal.pkl"), envs)
    normal.training = False
    return Learned(PPO.load(FOLDER / "model.zip", device="cpu"), normal)


if __name__ == "__main__":
    tyro.cli(learn)
