"""The number of BLAS threads decides no bit of what is learned, adapted or done."""

import os

import pytest

PROGRAM = """\
import hashlib
import numpy as np
from threadpoolctl import threadpool_info
from gplfd_experiments.data.teacher import Teacher
from gplfd_policies import POLICIES, TrainingInput, ViaPoint, adapt, batch_agents

rng = np.random.default_rng(0)
demonstrations = Teacher().demonstrate_doors((0.35, 0.5), 2, rng=rng)
method = POLICIES["gp"].method
skill = method.learn(TrainingInput(demonstrations=demonstrations))
adapted = adapt(skill, [ViaPoint(phase=0.2, pose=np.full(6, 0.02))])
arrays = [adapted.predict(np.linspace(0.0, 1.0, 150)).covariance]
batch = batch_agents([method.follow(skill) for _ in range(2)])
path = skill.predict(np.linspace(0.0, 0.4, 30)).mean
for number, pose in enumerate(path):
    observation = {"ee_pose": np.stack([pose, pose]), "wrench": np.zeros((2, 6))}
    if not number:
        batch.reset(observation)
    arrays += [batch.act(observation).action]
digest = hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()
pools = [pool for pool in threadpool_info() if pool["user_api"] == "blas"]
print(digest, {pool["num_threads"] for pool in pools})
"""


@pytest.mark.bits
@pytest.mark.slow
def test_results_do_not_depend_on_the_number_of_threads(run_python, capsys):
    """In this process, and in one with another number."""
    exec(PROGRAM, {})
    here = capsys.readouterr().out
    other = "2" if os.environ.get("OPENBLAS_NUM_THREADS") == "1" else "1"
    ran = run_python("-W", "ignore", "-c", PROGRAM, OPENBLAS_NUM_THREADS=other)
    assert ran.stdout == here
    assert here.split()[1] == "{1}"
