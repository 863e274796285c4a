"""Skills in files: learned once, followed on any door."""

import time
from functools import partial
from pathlib import Path

from threadpoolctl import threadpool_limits

from experiments.arguments import check_folder, check_least
from experiments.datasets.npz import load_demonstrations
from experiments.progress import LOG
from policies.method import Method, TrainingInput
from policies.registry import POLICIES, policy_named
from policies.skill import Skill, fit_skill


def skill_method(policy: str) -> Method:
    """Return the method of a policy that learns and follows skills.

    Raises:
        ValueError: There is no such policy, or it learns something else.
    """
    method = policy_named(policy).method
    if method is not None and _fits_skills(method):
        return method
    able = [
        name
        for name, one in POLICIES.items()
        if one.method is not None and _fits_skills(one.method)
    ]
    raise ValueError(
        f"policy {policy!r} learns no skill that a file could hold; choose one of "
        f"{', '.join(sorted(able))}"
    )


def _fits_skills(method: Method) -> bool:
    fit = method.fit
    return (fit.func if isinstance(fit, partial) else fit) is fit_skill


def learn_skill(demonstrations: Path, file: Path, *, policy: str, seed: int) -> Skill:
    """Learn a skill from a file of demonstrations and keep it in another.

    Args:
        demonstrations: File of `experiments.datasets.npz`.
        file: Where to write the skill; an existing file is replaced.
        policy: Name of a policy that learns skills.
        seed: Seeds whatever is random in the learning.

    Raises:
        ValueError: An argument or the file of demonstrations is wrong.
        OSError: A file cannot be read or written.
    """
    check_least("--seed", seed, 0)
    method = skill_method(policy)
    check_folder(file.parent)
    given = load_demonstrations(demonstrations).demonstrations
    LOG.info("learning from %d demonstrations", len(given))
    started = time.perf_counter()
    with threadpool_limits(limits=1, user_api="blas"):
        movement = method.learn(TrainingInput(demonstrations=given, seed=seed))
    if not isinstance(movement, Skill):
        raise TypeError(f"fit_skill made a {type(movement).__name__}")
    movement.save(file)
    LOG.info("learned (%.1f s)", time.perf_counter() - started)
    return movement
