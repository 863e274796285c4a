"""A policy of your own against the same door, logged and measured like the others.

It plays the demonstrations' mean at half speed, without compliance: what the field
calls open-loop replay. It opens the door that is the demonstrations' mean and loses the
handle of the others. Anything with `reset`, `act` and `forecast` will do.
"""

import gymnasium as gym
import numpy as np

from experiments.episodes.metrics import episode_metrics
from experiments.episodes.rollout import rollout
from experiments.teacher import DEMONSTRATED_RADII, Teacher
from gplfd_env import ENVIRONMENT_ID
from policies import AgentStep, align, fit_skill


class Replay:
    """Commands the mean of the demonstrations, whatever the door does."""

    def __init__(self, demonstrations, slow_down=2.0, control_period=0.01):
        skill = fit_skill(align(demonstrations))
        steps = round(slow_down * skill.duration / control_period)
        self.phases = np.linspace(0.0, 1.0, steps)
        self.trajectory = skill.predict(self.phases)
        self.step = 0

    def reset(self, observation):
        self.step = 0

    def act(self, observation):
        now = min(self.step, self.phases.size - 1)
        self.step += 1
        pose, none = self.trajectory.mean[now], np.full(6, np.nan)
        phase = float(self.phases[now])
        return AgentStep(
            action=pose, desired=pose, std=self.trajectory.std[now], std_rate=none,
            stiffness=none, stiffness_rate=none, stability_margin=none,
            phase=phase, observed_phase=phase,
            predicted_mean=none, predicted_std=none, via_point=False,
        )  # fmt: skip

    def forecast(self):
        return self.trajectory


demonstrations = Teacher().demonstrate_doors(
    DEMONSTRATED_RADII, per_radius=2, rng=np.random.default_rng(0)
)
agent = Replay(demonstrations)
for name in ("small", "medium", "large"):
    env = gym.make(ENVIRONMENT_ID, door=name)
    log = rollout(env, agent, policy="replay", door=name, seed=0)
    measured = episode_metrics(log)
    print(
        f"{name}: {measured.final_angle_deg:.1f} deg, "
        f"radial force {measured.force_radial_peak:.1f} N, "
        f"{'opened' if measured.success else measured.failure}"
    )
    env.close()
