"""Demonstrations that several tests of the policies share."""

import inspect
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import jaxtyping
import numpy as np
import pytest

from gplfd_env import DoorConfig, DoorGeometry
from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_policies import (
    Agent,
    AlignedDemonstrations,
    Demonstration,
    Method,
    Skill,
    TrainingInput,
    align,
    fit_skill,
    make_agent,
    policy_named,
)
from gplfd_policies.gp.heteroscedastic import KerstingNoise
from gplfd_policies.movements.baselines.wishart_gp import WishartGPConfig
from gplfd_policies.movements.movement import Movement

RADII = (0.35, 0.50, 0.65)


@pytest.fixture(scope="session")
def demonstrations() -> tuple[Demonstration, ...]:
    """Two openings of each of three doors, with a smooth millimetre of wobble."""
    rng = np.random.default_rng(0)
    demonstrations = []
    for radius in np.repeat(RADII, 2):
        times = np.linspace(0.0, rng.uniform(5.0, 7.0), 200)
        share = times / times[-1]
        progress = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        final = np.radians(67.0 + rng.normal())
        poses = handle_pose_on_arc(radius, final * progress)
        phase = rng.uniform(0.0, 2.0 * np.pi, 6)
        wobble = np.sin(np.outer(times, rng.uniform(1.0, 2.0, 6)) + phase)
        amplitude = np.repeat([1e-3, 5e-3], 3)
        poses += amplitude * (wobble - wobble[0])
        demonstrations.append(Demonstration(times=times, poses=poses))
    return tuple(demonstrations)


@pytest.fixture(scope="session")
def aligned(demonstrations: tuple[Demonstration, ...]) -> AlignedDemonstrations:
    return align(demonstrations)


@pytest.fixture(scope="session")
def skill(aligned: AlignedDemonstrations) -> Skill:
    return fit_skill(aligned)


@pytest.fixture(scope="session")
def library() -> dict[str, np.ndarray]:
    """Results of movement_primitives: data/make_movement_primitives.py at 758cbed."""
    with np.load(Path(__file__).parent / "data/movement_primitives.npz") as stored:
        return dict(stored)


@pytest.fixture
def as_for_users(monkeypatch: pytest.MonkeyPatch) -> None:
    """Switch run-time type checks off, which would come before a message."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)


def fitted_in_few_iterations(fit: Callable[..., Movement]) -> Callable[..., Movement]:
    """Shorten chains of samples and the paper's noise model, which takes seconds."""
    match getattr(fit, "keywords", {}):
        case {"config": WishartGPConfig() as chain}:
            short = replace(chain, steps=20, discarded=5, times=15, mode_iterations=20)
            return partial(fit, config=short)
        case {"noise": KerstingNoise() as noise}:
            return partial(fit, noise=replace(noise, n_iterations=1))
        case {"noise": "kersting"}:
            return partial(fit, noise=KerstingNoise(n_iterations=1))
    return fit


@pytest.fixture(scope="session")
def learned() -> Callable[[Method, Sequence[Demonstration]], Movement]:
    """Learn movements, each once for all methods that learn alike.

    From 80 samples, in few iterations, unchecked types: a method's tests have them all.
    """
    movements: dict[str, Movement] = {}
    lessons = []  # kept, so that no other demonstration gets the identity of one

    def learn(method: Method, lesson: Sequence[Demonstration]) -> Movement:
        learner, pipeline = method.learner, method.pipeline
        how = learner.fit, pipeline.align, pipeline.beyond, learner.seeded
        key = f"{how} {[id(part) for part in lesson]}"
        if key not in movements:
            lessons.append(lesson)
            if "n_samples" in inspect.signature(pipeline.align).parameters:
                coarse = partial(pipeline.align, n_samples=80)
                pipeline = replace(pipeline, align=coarse)
            learner = replace(learner, fit=fitted_in_few_iterations(learner.fit))
            method = Method(learner=learner, pipeline=pipeline)
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(jaxtyping.config, "jaxtyping_disable", True)
                movements[key] = method.learn(TrainingInput(demonstrations=lesson))
        return movements[key]

    return learn


@pytest.fixture(scope="session")
def learned_agent(
    demonstrations: tuple[Demonstration, ...],
    learned: Callable[[Method, Sequence[Demonstration]], Movement],
) -> Callable[[str], Agent]:
    """Return agents by the name of a policy, which are told a door of half a metre."""

    def make(name: str) -> Agent:
        method = policy_named(name).method
        if method is None:
            agent = make_agent(name, ())
        else:
            lesson = demonstrations
            if method.pipeline.phase_stiffness is not None:
                lesson = tuple(
                    replace(motion, wrenches=np.full(motion.poses.shape, 2.0))
                    for motion in demonstrations
                )
            agent = method.follow(learned(method, lesson))
        agent.inform(DoorGeometry.of(DoorConfig(radius=0.5)))
        return agent

    return make
