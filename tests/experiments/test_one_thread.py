"""The number of BLAS threads decides no bit of what is learned, kept, adapted or done.

Run as a script, this file prints a digest of each of `results`. With ``--watch`` it
also lists the functions with linear algebra, and on how many threads it ran.
"""

import hashlib
import json
import os
import subprocess
import sys
import types
import warnings
from collections.abc import Iterator
from dataclasses import replace
from dis import get_instructions
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController

from gplfd_experiments.data.teacher import Teacher
from gplfd_policies import (
    POLICIES,
    Demonstration,
    GaussianTrajectory,
    Skill,
    TrainingInput,
    ViaPoint,
    adapt,
    batch_agents,
    load_skill,
    make_agent,
)
from gplfd_policies.adaptation import ADAPTATIONS
from gplfd_policies.gp.noise import KerstingNoise
from gplfd_policies.movements.baselines.wishart_gp import (
    WishartGPConfig,
    fit_wishart_gp,
)
from gplfd_policies.movements.movement import Movement
from gplfd_policies.movements.skill import fit_skill

pytestmark = pytest.mark.slow

WATCHED = {
    "gplfd_policies.adaptation.conditioning.ConditionedProcess.update",
    "gplfd_policies.movements.baselines.tp_gmm._maximised",
}
"""Some of the functions whose linear algebra must run on one thread."""
PHASES = np.linspace(0.0, 1.0, 150)
STEPS = 30
CHAIN = WishartGPConfig(steps=20, discarded=5, times=15, degrees=6)
QUICK = {
    "gp-paper": partial(fit_skill, noise=KerstingNoise(n_iterations=1)),
    "wishart-gp": partial(fit_wishart_gp, config=CHAIN),
}
"""How methods learn in few steps."""
LINEAR_ALGEBRA = {
    *("cho_factor", "cho_solve", "cholesky", "dot", "eigh", "eigvalsh", "inv", "lstsq"),
    *("matmul", "pinv", "qr", "slogdet", "solve", "solve_triangular", "svd", "vecdot"),
}


def results() -> Iterator[tuple[str, Any]]:
    """Everything that users ask of `gplfd_policies`, by its public names."""
    shown = Teacher().demonstrate_doors((0.35, 0.5), 2, rng=np.random.default_rng(0))
    yield "demonstrations", [one.poses for one in shown]
    for name, policy in POLICIES.items():
        method = policy.method
        if method is None or policy.kind != "method" or name.endswith("-tuned"):
            continue
        method = replace(method, fit=QUICK.get(name, method.fit))
        lesson = shown
        if method.phase_stiffness is not None:
            lesson = tuple(replace(one, wrenches=10.0 * one.poses) for one in shown)
        movement = method.learn(TrainingInput(demonstrations=lesson))
        yield f"{name}: learned", numbers(movement.predict(PHASES))
        yield f"{name}: acts", acted(method.follow(movement), movement)
        if name == "gp":
            assert isinstance(movement, Skill)
            yield from of_skill(movement, shown)


def of_skill(skill: Skill, shown: tuple[Demonstration, ...]) -> Iterator[Any]:
    yield "samples", skill.predict(PHASES).samples(2, np.random.default_rng(0))
    via_points = [ViaPoint(phase=s, pose=np.full(6, 0.1 * s)) for s in (0.2, 0.5)]
    for form in ADAPTATIONS:
        adapted = adapt(skill, via_points, form).predict(PHASES)
        yield f"adapted: {form}", numbers(adapted)
    with TemporaryDirectory() as folder:
        skill.save(Path(folder) / "skill.npz")
        kept = load_skill(Path(folder) / "skill.npz")
    method = POLICIES["gp"].method
    assert method is not None
    yield "gp: kept", numbers(kept.predict(PHASES))
    yield "gp: acts as kept", acted(method.follow(kept), kept)
    yield "gp: acts as made", acted(make_agent("gp", shown), skill)
    batch = batch_agents([method.follow(skill), method.follow(kept)])
    path = skill.predict(np.linspace(0.0, 0.4, STEPS)).mean
    observations = [
        {"ee_pose": np.stack([pose, pose]), "wrench": np.zeros((2, 6))} for pose in path
    ]
    batch.reset(observations[0])
    yield "gp: acts in lockstep", [batch.act(each).action for each in observations]


def acted(agent: Any, movement: Movement) -> list[np.ndarray]:
    """What an agent does whose hand moves as the movement says, and then expects."""
    actions = []
    for pose in movement.predict(np.linspace(0.0, 0.4, STEPS)).mean:
        observation = {"ee_pose": pose, "wrench": np.zeros(6)}
        if not actions:
            agent.reset(observation)
        step = agent.act(observation)
        actions += [step.action, step.std, step.stiffness]
    return [*actions, *numbers(agent.forecast())]


def numbers(trajectory: GaussianTrajectory) -> list[np.ndarray]:
    return [trajectory.mean, trajectory.std, trajectory.covariance]


def digest(arrays: Any) -> str:
    return hashlib.sha256(
        b"".join(np.ascontiguousarray(each).tobytes() for each in arrays)
    ).hexdigest()


class Watch:
    """Notes functions of ours with linear algebra that run on several BLAS threads."""

    def __init__(self) -> None:
        controller = ThreadpoolController().select(user_api="blas")
        self.libraries = controller.lib_controllers
        self.seen: dict[types.CodeType, bool] = {}
        self.names: dict[bool, set[str]] = {True: set(), False: set()}

    def __call__(self, frame: types.FrameType, _event: str, _: object) -> None:
        """Trace a call, and none of its lines."""
        code, module = frame.f_code, frame.f_globals.get("__name__", "")
        # Not gplfd_env: its matrices have the seven rows of the arm at most.
        if not module.startswith(("gplfd_policies.", "gplfd_experiments.")):
            return
        if code not in self.seen:
            self.seen[code] = not LINEAR_ALGEBRA.isdisjoint(code.co_names) or any(
                each.opname == "BINARY_OP" and each.argrepr in ("@", "@=")
                for each in get_instructions(code)
            )
        if self.seen[code]:
            alone = all(each.get_num_threads() == 1 for each in self.libraries)
            self.names[alone].add(f"{module}.{code.co_qualname}")


def main() -> None:
    warnings.simplefilter("ignore")
    watch = Watch()
    if "--watch" in sys.argv:
        sys.settrace(watch)
    for name, arrays in results():
        print(f"{name}: {digest(arrays)}")
    sys.settrace(None)
    watched = {"one": sorted(watch.names[True]), "several": sorted(watch.names[False])}
    print(json.dumps(watched), file=sys.stderr)


@pytest.mark.bits
def test_linear_algebra_runs_on_one_thread():
    """With one BLAS thread and with two the bits are the same.

    Small products have the same bits on many threads with some kernels, so that equal
    bits alone do not show the limit. Hence the list of functions that ran without it.
    """
    running = [
        subprocess.Popen(
            [sys.executable, __file__, *options],
            env={**os.environ, "OPENBLAS_NUM_THREADS": threads},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for threads, *options in (["1"], ["2", "--watch"])
    ]
    (one, _), (two, said) = (each.communicate() for each in running)
    assert [each.returncode for each in running] == [0, 0], said
    assert two.splitlines() == one.splitlines()
    results = dict(line.rsplit(": ", 1) for line in one.splitlines())
    assert results["gp: kept"] == results["gp: learned"]
    assert results["gp: acts as kept"] == results["gp: acts"]
    assert results["gp: acts as made"] == results["gp: acts"]
    watched = json.loads(said)
    assert watched["several"] == []
    assert {*watched["one"]} >= WATCHED


LIMITS = """\
import os
import threading
import warnings

import scipy.linalg  # Limits hold for the BLAS libraries that are loaded.
from threadpoolctl import threadpool_info, threadpool_limits

from gplfd_policies.arrays.one_thread import one_thread

warnings.simplefilter("ignore")  # of a fork beside other threads


def threads():
    found = (pool for pool in threadpool_info() if pool["user_api"] == "blas")
    (number,) = {pool["num_threads"] for pool in found}
    return number


entered, leave = threading.Event(), threading.Event()


@one_thread
def compute():
    entered.set()
    assert leave.wait(60)


with threadpool_limits(limits=2, user_api="blas"):
    other = threading.Thread(target=compute)
    with one_thread:
        other.start()
        assert entered.wait(60)
        # Not by a thread that stays in the parent, nor by the block that it forked in.
        child = os.fork()
        if not child:
            seen = [threads()]
            with one_thread:
                seen.append(threads())
            seen.append(threads())
    if not child:
        seen.append(threads())
        with one_thread:
            seen.append(threads())
        seen.append(threads())
        print(seen, flush=True)
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
    assert threads() == 1  # as the other thread computes
    leave.set()
    other.join(60)
    assert threads() == 2
    # The first thread that sets a number is another than the last.
    seen = []
    look = threading.Thread(target=one_thread(lambda: seen.append(threads())))
    look.start()
    look.join(60)
    assert (seen, threads()) == ([1], 2)
    try:
        with one_thread, one_thread:
            raise ZeroDivisionError
    except ZeroDivisionError:
        assert threads() == 2
    else:
        raise AssertionError
"""


def test_the_limit_ends_with_the_last_that_computes_and_at_a_fork():
    """Of all threads of a process, which share one number of BLAS threads."""
    ended = subprocess.run(
        [sys.executable, "-c", LIMITS],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout == "[2, 1, 2, 2, 1, 2]\n"


if __name__ == "__main__":
    main()
