"""How far a method returns to a prior mean, with known answers."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.studies.learning_tests.extrapolation import prior_mean_used
from gplfd_experiments.studies.learning_tests.methods import learn
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.alignment import align
from gplfd_policies.movements.movement import Movement
from gplfd_policies.movements.trajectory import GaussianTrajectory
from gplfd_policies.registry.catalogue import POLICIES
from gplfd_policies.registry.method import Method, TrainingInput

DEMONSTRATIONS = Teacher().demonstrate_doors(
    (0.35, 0.50, 0.65), 2, rng=np.random.default_rng(0)
)


@dataclasses.dataclass(frozen=True)
class Following:
    """At a given share of the way from the average pose to the prior mean."""

    aligned: AlignedDemonstrations
    training: TrainingInput
    share: float
    duration: float = 6.0

    def predict(self, times: np.ndarray) -> GaussianTrajectory:
        mean = np.tile(self.aligned.poses.mean(axis=(0, 1)), (len(times), 1))
        if self.training.prior_mean is not None:
            mean += self.share * (self.training.prior_mean.mean(times) - mean)
        return GaussianTrajectory.from_moments(
            times, mean, np.full_like(mean, np.nan), lambda: np.zeros((6, 1, 1))
        )


class Untaught(Method):
    """Makes its movement from the whole training input."""

    def learn(self, training: TrainingInput) -> Movement:
        return self.fit(training)


def used(learner: Callable[[TrainingInput], Movement]) -> float | None:
    return used_by(Untaught(fit=learner, accepts_prior_mean=True))


def used_by(method: Method) -> float | None:
    plain, _ = learn(method, DEMONSTRATIONS, 0)
    return prior_mean_used(method, DEMONSTRATIONS, 0, plain)


@pytest.mark.parametrize(
    ("share", "expected"), [(0.0, 0.0), (0.4, 0.4), (1.0, 1.0), (-0.5, 0.0), (2.0, 1.0)]
)
def test_share_of_the_way_to_the_prior_mean(share: float, expected: float) -> None:
    def learner(training: TrainingInput) -> Following:
        return Following(align(training.demonstrations), training, share)

    assert used(learner) == pytest.approx(expected, abs=1e-12)


def test_correcting_the_prior_mean_everywhere_is_not_returning_to_it() -> None:
    """A residual learned about its own average keeps that average beyond."""

    @dataclasses.dataclass(frozen=True)
    class Correcting(Following):
        def predict(self, times: np.ndarray) -> GaussianTrajectory:
            rest = super().predict(times)
            prior, aligned = self.training.prior_mean, self.aligned
            if prior is None:
                return rest
            error = np.mean(aligned.poses - prior.mean(aligned.times), axis=(0, 1))
            return dataclasses.replace(rest, mean=prior.mean(times) + error)

    def learner(training: TrainingInput) -> Correcting:
        return Correcting(align(training.demonstrations), training, 1.0)

    share = used(learner)
    assert share is not None
    assert share < 0.9


@pytest.mark.parametrize("policy", ["gp", "gp-paper", "local-gp"])
@pytest.mark.filterwarnings("ignore:sensor noise")
def test_processes_return_to_the_prior_mean(policy: str) -> None:
    assert used_by(POLICIES[policy].method) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("policy", ["dmp", "promp", "gmr", "kmp", "gmm-gp"])
def test_methods_that_take_none_have_no_share(policy: str) -> None:
    assert used_by(POLICIES[policy].method) is None


def test_failures_are_not_hidden() -> None:
    def learner(training: TrainingInput) -> Following:
        if training.prior_mean is not None:
            raise ValueError("something else")
        return Following(align(training.demonstrations), training, 1.0)

    with pytest.raises(ValueError, match="something else"):
        used(learner)
