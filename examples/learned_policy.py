"""PPO on `gplfd/DoorOpeningRL-v1`, evaluated like the policies; needs the extra sb3.

    python examples/learned_policy.py --steps 700000 --out results/ppo
    gplfd run --policy examples/learned_policy.py:make
    gplfd benchmark --config small --policies gp examples/learned_policy.py:make

The first command learns and writes `results/ppo/model.zip` and `curve.json`: how many
doors the policy opened, and with what force, after how many steps. The others read the
model from there, or from the folder that the environment variable GPLFD_LEARNED names.

Exploration is decisive, because the reward penalises the greatest force so far.
Decisions are made at 10 Hz and held. The exploration noise is a function of the
observation, drawn once per rollout (gSDE, Raffin et al. 2022): noise that changes
between decisions causes force, but does not move the door. The noise is small, and no
update may change the policy by much relative to the noise.
"""

import argparse
import json
import os
import time
from pathlib import Path

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnvWrapper, VecMonitor, VecNormalize

from gplfd_env.wrappers import command_of, flat_of
from gplfd_env.wrappers.sb3 import make_sb3

FOLDER = Path(os.environ.get("GPLFD_LEARNED", "results/ppo"))
RADII = [0.30, 0.35, 0.40, 0.45, 0.50, 0.55, 0.60, 0.65]  # [m]
JUDGED = [0.35, 0.42, 0.50, 0.58, 0.65]  # [m]
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
        total = np.zeros(self.num_envs, dtype=np.float32)
        ended = np.zeros(self.num_envs, dtype=bool)
        said = [{} for _ in ended]
        for _ in range(HELD):
            seen, rewards, dones, infos = self.venv.step(self.actions)
            total[~ended] += rewards[~ended]
            said = [
                old if over else new
                for old, new, over in zip(said, infos, ended, strict=True)
            ]
            ended |= dones
            self.actions[ended] = 0.0
        return seen, total, ended, said


class Learned:
    """An agent: the mean action of the network for the observation, as a pose."""

    def __init__(self, model, normal):
        self.model, self.normal = model, normal

    def reset(self, observation):
        self.steps = 0

    def act(self, observation):
        if self.steps % HELD == 0:
            seen = self.normal.normalize_obs(flat_of(observation))
            self.action, _ = self.model.predict(seen, deterministic=True)
        self.steps += 1
        return command_of(self.action, observation["ee_pose"])


class Curve(BaseCallback):
    """Evaluates the policy without noise, at intervals and at the end."""

    def __init__(self, normal, every, out):
        super().__init__()
        self.normal, self.every, self.out = normal, every, out
        self.rows, self.due = [], 0
        self.began = time.process_time()

    def _on_step(self):
        return True

    def _on_rollout_start(self):
        if self.num_timesteps >= self.due:
            self.due += self.every
            self.judge()

    def _on_training_end(self):
        self.judge()

    def judge(self):
        """Add a row to the curve."""
        spent = time.process_time() - self.began
        row = {
            "steps": HELD * self.num_timesteps,
            "cpu_s": round(spent),
            **self.judged(),
        }
        print(json.dumps(row), flush=True)
        self.rows.append(row)
        (self.out / "curve.json").write_text(json.dumps(self.rows, indent=1) + "\n")

    def judged(self):
        """Return the results of one episode per door."""
        envs = HeldActions(make_sb3(len(JUDGED), door=JUDGED))
        seen, ended = envs.reset(), {}
        while len(ended) < len(JUDGED):
            action, _ = self.model.predict(
                self.normal.normalize_obs(seen), deterministic=True
            )
            seen, _, dones, infos = envs.step(action)
            for row in np.flatnonzero(dones):
                ended.setdefault(int(row), infos[row])
        envs.close()
        said = list(ended.values())
        return {
            "opened": sum(info["success"] for info in said),
            "of": len(said),
            "return": float(np.mean([info["return"] for info in said])),
            "angle_deg": float(np.degrees(np.mean([i["door_angle"] for i in said]))),
            "peak_force": float(np.median([info["peak_force"] for info in said])),
        }


def learn(steps, out, seed=0):
    """Learn, and write the model and its learning curve into a folder."""
    torch.set_num_threads(1)
    out.mkdir(parents=True, exist_ok=True)
    doors = 2 * RADII
    envs = make_sb3(len(doors), door=doors)
    normal = VecNormalize(VecMonitor(HeldActions(envs)), gamma=0.99)
    model = PPO(
        "MlpPolicy",
        normal,
        n_steps=64,
        batch_size=256,
        n_epochs=10,
        gamma=0.99,
        learning_rate=lambda left: 1e-3 * left,
        target_kl=0.03,
        use_sde=True,
        seed=seed,
        policy_kwargs={"log_std_init": -4.5, "net_arch": [64, 64]},
    )
    decisions = steps // HELD
    model.learn(decisions, callback=Curve(normal, decisions // 20, out))
    model.save(out / "model.zip")
    normal.save(str(out / "normal.pkl"))


def make(training):
    """The policy that PPO learned, from its folder."""
    envs = make_sb3(1)
    normal = VecNormalize.load(str(FOLDER / "normal.pkl"), envs)
    normal.training = False
    return Learned(PPO.load(FOLDER / "model.zip", device="cpu"), normal)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--steps", type=int, default=700_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=FOLDER)
    given = parser.parse_args()
    learn(given.steps, given.out, given.seed)
