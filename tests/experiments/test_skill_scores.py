"""Every method of Table 1 is measured alike, and learns from what it is given."""

import dataclasses
import functools
import json
from typing import Any

import numpy as np
import pytest

from gplfd_experiments.data.teacher import Teacher, TeacherConfig
from gplfd_experiments.studies.learning_tests.folds import folds
from gplfd_experiments.studies.learning_tests.methods import learn
from gplfd_experiments.studies.learning_tests.scores import method_metrics
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.alignment import align
from gplfd_policies.movements.baselines.wishart_gp import (
    WishartGPConfig,
    fit_wishart_gp,
)
from gplfd_policies.movements.trajectory import GaussianTrajectory
from gplfd_policies.registry.built_in import TABLE_1
from gplfd_policies.registry.catalogue import POLICIES
from gplfd_policies.registry.method import Method, TrainingInput

RADII = (0.35, 0.50, 0.65)
TEACHER = dataclasses.asdict(TeacherConfig(duration_mean=2.0, sampling_rate=30.0))


@dataclasses.dataclass(frozen=True)
class Still:
    """A movement that stays where it is."""

    aligned: AlignedDemonstrations
    duration: float = 6.0

    def predict(self, times: np.ndarray) -> GaussianTrajectory:
        pose = np.zeros((len(times), 6))
        return GaussianTrajectory.from_moments(
            times, pose, pose + 1.0, lambda: np.zeros((6, 1, 1))
        )


class Untaught(Method):
    """Makes its movement from the whole training input."""

    def learn(self, training: TrainingInput) -> Any:
        return self.fit(training)


@pytest.mark.parametrize("held_out", ["demonstration", "radius"])
def test_methods_are_given_the_folds_and_nothing_else(held_out: str) -> None:
    given: list[TrainingInput] = []

    def learn_and_tell(training: TrainingInput) -> Still:
        given.append(training)
        return Still(align(training.demonstrations))

    method_metrics(
        Untaught(fit=learn_and_tell),
        seed=3,
        demonstrations_per_door=2,
        teacher=TEACHER,
        held_out=held_out,
    )
    recorded = Teacher(TeacherConfig(**TEACHER)).demonstrate_doors(
        RADII, 2, rng=np.random.default_rng(3)
    )
    doors = [recorded[:2], recorded[2:4], recorded[4:]]
    for fold, training in zip(folds(doors, held_out, 3), given[:2], strict=True):
        assert training.seed == 3
        for own, other in zip(fold.given, training.demonstrations, strict=True):
            np.testing.assert_array_equal(own.poses, other.poses)


def test_learning_time_includes_what_is_put_off_until_prediction() -> None:
    asked = []

    class Lazy(Still):
        def predict(self, times: np.ndarray) -> GaussianTrajectory:
            asked.append(times)
            return super().predict(times)

    method = Method(fit=Lazy)
    _, cpu_s = learn(method, [Teacher().demonstrate(0.5, np.random.default_rng(0))], 0)
    assert len(asked) == 1
    assert cpu_s > 0.0


def metrics_of(policy: str, held_out: str) -> dict[str, Any]:
    method = POLICIES[policy].method
    assert method is not None
    if policy == "wishart-gp":
        # A short chain shows what is measured; the whole one takes half a minute.
        chain = WishartGPConfig(steps=20, discarded=5, times=15, degrees=6)
        fit = functools.partial(fit_wishart_gp, config=chain)
        method = dataclasses.replace(method, fit=fit)
    return method_metrics(
        method,
        seed=0,
        demonstrations_per_door=2,
        teacher=TEACHER,
        held_out=held_out,
    )


@pytest.mark.parametrize("policy", TABLE_1)
def test_every_method_of_table_1_is_measured(policy: str) -> None:
    metrics = metrics_of(policy, "demonstration")
    json.dumps(metrics, allow_nan=False)
    assert metrics["rmse_position_m"] < 0.3
    assert metrics["cpu_fit_s"] > 0.0
    assert (metrics["nlpd"] is None) == (policy == "dmp")
    adapts = policy in ("promp", "kmp", "gmm-gp", "gp-paper", "gp")
    assert (metrics["via_error_position_m"] is not None) == adapts
    informed = policy in ("local-gp", "wishart-gp", "gp-paper", "gp")
    assert (metrics["prior_mean_used"] is not None) == informed
    assert (metrics["coverage_95_stated"] is not None) == (policy in ("gp", "gp-paper"))


@pytest.mark.parametrize("policy", ["dmp", "gmr", "gmm-gp"])
def test_kinds_of_tasks_share_their_names_but_for_the_extra_tests(policy: str) -> None:
    one, other = (set(metrics_of(policy, kind)) for kind in ("demonstration", "radius"))
    assert one - other == {
        "uncertainty_growth",
        "coverage_95_beyond",
        "prior_mean_used",
    }
    assert other - one == {
        "outputs_cpu_s",
        "outputs_nlpd",
        "outputs_nlpd_change",
        "tumbling_error",
    }
