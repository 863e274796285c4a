"""A diffusion policy that learns from demonstrations; needs the extra learners.

    gplfd run --policy examples/diffusion_policy.py:make
    gplfd benchmark --config small --policies gp examples/diffusion_policy.py:make

Model, noise schedule, sampling and chunks: arXiv:2303.04137, 2102.09672, 2010.02502
(DDIM), 2402.10329. A network predicts the noise in a chunk of future poses, relative to
the present pose and in its axes; it knows no time, phase, force or radius. Deviations:
a residual MLP instead of a U-Net, because the state has six numbers; one pose of every
chunk is executed.
"""

import math

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from torch import nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from gplfd_env.conventions.constants import CONTROL_PERIOD

PERIOD = 0.1  # [s]; time between the poses of a chunk
CHUNK = 16  # predicted poses; the first is executed
WIDTH, BLOCKS = 256, 3  # size of the network
LEVELS, DENOISED = 50, 10  # noise levels in training, and denoising steps
STEPS, BATCH, RATE, AVERAGE = 3000, 128, 1e-3, 0.995  # of training

torch.set_num_threads(1)


class Block(nn.Sequential):
    """A residual block."""

    def __init__(self):
        first, second = nn.Linear(WIDTH, WIDTH), nn.Linear(WIDTH, WIDTH)
        super().__init__(nn.LayerNorm(WIDTH), first, nn.SiLU(), second)

    def forward(self, hidden):
        return hidden + super().forward(hidden)


class Denoiser(nn.Module):
    """Predicts the noise in chunks (B, 96), for states (B, 6) and levels (B,).

    Chunks and states are scaled to ±1 by their range in the training data.
    """

    def __init__(self, **training):
        super().__init__()
        self.scales = {}
        for name, rows in training.items():
            low, high = rows.amin(dim=0), rows.amax(dim=0)
            self.scales[name] = (low + high) / 2, ((high - low) / 2).clamp(min=1e-5)
        self.blocks = nn.Sequential(
            nn.Linear(6 * CHUNK + 6 + 32, WIDTH),
            *(Block() for _ in range(BLOCKS)),
            nn.LayerNorm(WIDTH),
            nn.Linear(WIDTH, 6 * CHUNK),
        )
        progress = (torch.arange(LEVELS + 1) / LEVELS + 0.008) / 1.008
        kept = torch.cos(0.5 * math.pi * progress) ** 2
        lost = (1.0 - kept[1:] / kept[:-1]).clamp(max=0.999)
        self.signal = torch.cumprod(1.0 - lost, dim=0)
        self.frequencies = torch.exp(-math.log(1e4) * torch.arange(16) / 16)

    def forward(self, chunks, states, levels):
        angles = levels[:, None] * self.frequencies
        inputs = chunks, states, angles.sin(), angles.cos()
        return self.blocks(torch.cat(inputs, dim=1))

    def scaled(self, name, rows):
        centre, scale = self.scales[name]
        return (rows - centre) / scale

    @torch.no_grad()
    def sample(self, pose, noise):
        """Return the chunk (16, 6) denoised from noise (1, 96) at a pose (6,)."""
        state = self.scaled("state", torch.tensor(pose, dtype=torch.float32)[None])
        chunk = noise
        levels = torch.linspace(LEVELS - 1, 0, DENOISED).round().long()
        after = [*self.signal[levels[1:]], torch.ones(())]
        for level, kept in zip(levels, after, strict=True):
            signal = self.signal[level]
            noise = self(chunk, state, level[None])
            clean = (chunk - (1.0 - signal).sqrt() * noise) / signal.sqrt()
            clean = clean.clamp(-1.0, 1.0)
            noise = (chunk - signal.sqrt() * clean) / (1.0 - signal).sqrt()
            chunk = kept.sqrt() * clean + (1.0 - kept).sqrt() * noise
        centre, scale = self.scales["chunk"]
        return (centre + scale * chunk).reshape(CHUNK, 6).numpy().astype(float)


def lessons(demonstrations):
    """Return states (N, 6) and the chunk after each, (N, 96), for every sample."""
    states, chunks = [], []
    for demonstration in demonstrations:
        poses, recorded = np.array(demonstration.poses), demonstration.times
        times = recorded[:, None] + PERIOD * np.arange(1, CHUNK + 1)
        # After its end, a demonstration stays at the last pose.
        ahead = np.stack([np.interp(times, recorded, curve) for curve in poses.T], -1)
        here = np.repeat(poses, CHUNK, axis=0)
        ahead, axes = ahead.reshape(-1, 6), Rotation.from_rotvec(here[:, 3:]).inv()
        moved = axes.apply(ahead[:, :3] - here[:, :3])
        turned = (axes * Rotation.from_rotvec(ahead[:, 3:])).as_rotvec()
        states.append(poses)
        chunks.append(np.hstack([moved, turned]).reshape(len(poses), -1))
    return (torch.tensor(np.concatenate(rows)).float() for rows in (states, chunks))


def learn(demonstrations, seed):
    """Train a network; its weights are averaged over the last few hundred steps."""
    torch.manual_seed(seed)
    states, chunks = lessons(demonstrations)
    network = Denoiser(state=states, chunk=chunks)
    states, chunks = network.scaled("state", states), network.scaled("chunk", chunks)
    averaged = AveragedModel(network, multi_avg_fn=get_ema_multi_avg_fn(AVERAGE))
    optimizer = torch.optim.AdamW(network.parameters(), weight_decay=1e-6)
    rates = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, RATE, total_steps=STEPS, pct_start=0.1, cycle_momentum=False
    )
    for _ in range(STEPS):
        rows = torch.randint(len(states), (BATCH,))
        levels = torch.randint(LEVELS, (BATCH,))
        noise = torch.randn(BATCH, 6 * CHUNK)
        signal = network.signal[levels, None]
        noisy = signal.sqrt() * chunks[rows] + (1.0 - signal).sqrt() * noise
        loss = nn.functional.mse_loss(network(noisy, states[rows], levels), noise)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        rates.step()
        averaged.update_parameters(network)
    return averaged.module.eval()


class Diffusion:
    """An agent: the network predicts poses from the pose of the hand at 10 Hz.

    The command goes linearly from the last command to the first predicted pose.
    """

    def __init__(self, network, seed):
        self.network, self.seed = network, seed

    def reset(self, observation):
        self.random = torch.Generator().manual_seed(self.seed)
        self.step, self.command = 0, observation["ee_pose"]

    def act(self, observation):
        period = round(PERIOD / CONTROL_PERIOD)
        since = self.step % period
        if since == 0:
            hand = observation["ee_pose"]
            noise = torch.randn(1, 6 * CHUNK, generator=self.random)
            ahead = self.network.sample(hand, noise)[0]
            axes = Rotation.from_rotvec(hand[3:])
            turned = (axes * Rotation.from_rotvec(ahead[3:])).as_rotvec()
            goal = np.hstack([hand[:3] + axes.apply(ahead[:3]), turned])
            self.plan = np.stack([self.command, goal])
        self.step += 1
        at = (since + 1) / period
        self.command = np.array([np.interp(at, (0, 1), ends) for ends in self.plan.T])
        return self.command


def make(training):
    """Diffusion over chunks of poses."""
    return Diffusion(learn(training.demonstrations, training.seed), training.seed)
