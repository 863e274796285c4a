"""The number of BLAS threads decides no bit of what is learned, kept, adapted or done.

Run as a script, this file prints a digest of each of `results`. With ``--watch`` it
also lists the functions with linear algebra, and on how many threads it ran.
"""

import functools
import hashlib
import json
import os
import subprocess
import sys
import threading
import types
import warnings
from collections.abc import Iterator
from dis import get_instructions
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController, threadpool_info, threadpool_limits

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
from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.movements.movement import Movement

pytestmark = pytest.mark.slow

WATCHED = {
    "gplfd_policies.adaptation.conditioning.ConditionedProcess.update",
    "gplfd_policies.movements.baselines.tp_gmm._maximised",
}
"""Some of the functions whose linear algebra must run on one thread."""
PHASES = np.linspace(0.0, 1.0, 150)
STEPS = 60
LINEAR_ALGEBRA = {
    *("cho_factor", "cho_solve", "cholesky", "dot", "eigh", "eigvalsh", "inv", "lstsq"),
    *("matmul", "pinv", "qr", "slogdet", "solve", "solve_triangular", "svd", "vecdot"),
}


def results() -> Iterator[tuple[str, Any]]:
    """Everything that users ask of `gplfd_policies`, by its public names."""
    shown = Teacher().demonstrate_doors((0.35, 0.5), 2, rng=np.random.default_rng(0))
    yield "demonstrations", [one.poses for one in shown]
    for name, policy in POLICIES.items():
        if policy.method is None or policy.kind != "method" or name.endswith("-tuned"):
            continue
        movement = policy.method.learn(TrainingInput(demonstrations=shown))
        yield f"{name}: learned", numbers(movement.predict(PHASES))
        yield f"{name}: acts", acted(policy.method.follow(movement), movement)
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
        self.limited: set[str] = set()
        self.unlimited: set[str] = set()

    def __call__(self, frame: types.FrameType, event: str, _: object) -> None:
        if event != "call" or not _multiplies(frame.f_code):
            return
        module = frame.f_globals.get("__name__", "")
        # Not gplfd_env: its matrices have the seven rows of the arm at most.
        if module.startswith(("gplfd_policies.", "gplfd_experiments.")):
            alone = all(each.get_num_threads() == 1 for each in self.libraries)
            name = f"{module}.{frame.f_code.co_qualname}"
            (self.limited if alone else self.unlimited).add(name)


@functools.cache
def _multiplies(code: types.CodeType) -> bool:
    return not LINEAR_ALGEBRA.isdisjoint(code.co_names) or any(
        each.opname == "BINARY_OP" and each.argrepr in ("@", "@=")
        for each in get_instructions(code)
    )


def main() -> None:
    warnings.simplefilter("ignore")
    watch = Watch()
    if "--watch" in sys.argv:
        sys.setprofile(watch)
    for name, arrays in results():
        print(f"{name}: {digest(arrays)}")
    sys.setprofile(None)
    watched = {"one": sorted(watch.limited), "several": sorted(watch.unlimited)}
    print(json.dumps(watched), file=sys.stderr)


@pytest.mark.bits
def test_linear_algebra_runs_on_one_thread() -> None:
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


def test_the_limit_ends_with_the_last_that_computes() -> None:
    """Of all threads of a process, which share one number of BLAS threads."""

    def numbers_of_threads() -> set[int]:
        return {
            pool["num_threads"]
            for pool in threadpool_info()
            if pool["user_api"] == "blas"
        }

    entered, leave = threading.Event(), threading.Event()

    @one_thread
    def compute() -> None:
        entered.set()
        assert leave.wait(60)

    with threadpool_limits(limits=2, user_api="blas"):
        other = threading.Thread(target=compute)
        with one_thread:
            other.start()
            assert entered.wait(60)
        assert numbers_of_threads() == {1}
        leave.set()
        other.join(60)
        assert not other.is_alive()
        assert numbers_of_threads() == {2}
        # The first thread that sets a number is another than the last.
        seen: list[set[int]] = []
        look = threading.Thread(
            target=one_thread(lambda: seen.append(numbers_of_threads()))
        )
        look.start()
        look.join(60)
        assert seen == [{1}]
        assert numbers_of_threads() == {2}
        with pytest.raises(ZeroDivisionError), one_thread, one_thread:
            raise ZeroDivisionError
        assert numbers_of_threads() == {2}


FORK = """\
import os
import threading
import warnings

import scipy.linalg  # Limits hold for the BLAS libraries that are loaded.
from threadpoolctl import threadpool_info, threadpool_limits

from gplfd_policies.arrays.one_thread import one_thread

warnings.simplefilter("ignore")  # of a fork beside other threads


def numbers_of_threads():
    found = (pool for pool in threadpool_info() if pool["user_api"] == "blas")
    return {pool["num_threads"] for pool in found}


entered, leave = threading.Event(), threading.Event()


@one_thread
def compute():
    entered.set()
    assert leave.wait(60)


with threadpool_limits(limits=2, user_api="blas"):
    other = threading.Thread(target=compute)
    other.start()
    assert entered.wait(60)
    with one_thread:
        child = os.fork()
        if not child:
            seen = [numbers_of_threads()]
            with one_thread:
                seen.append(numbers_of_threads())
            seen.append(numbers_of_threads())
    if not child:
        seen.append(numbers_of_threads())
        with one_thread:
            seen.append(numbers_of_threads())
        seen.append(numbers_of_threads())
        print(seen, flush=True)
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
    assert numbers_of_threads() == {1}
    leave.set()
    other.join(60)
    assert numbers_of_threads() == {2}
"""


def test_a_forked_child_is_not_limited_by_its_parent() -> None:
    """Not by a thread that stays in the parent, nor by the block that it forked in."""
    ended = subprocess.run(
        [sys.executable, "-c", FORK],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.split("\n")[0] == "[{2}, {1}, {2}, {2}, {1}, {2}]"


if __name__ == "__main__":
    main()
