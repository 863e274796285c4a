"""Joint outputs, Eq. (6)."""

import numpy as np
import pytest

from policies.gp.coregionalisation import (
    Coregionalisation,
    CoregionalisedGP,
    fit_coregionalisation,
)
from policies.gp.exact import ExactGP
from policies.gp.kernels import RBF

TIMES = np.linspace(0.0, 1.0, 20)
GRID = np.linspace(-0.1, 1.1, 9)


def coupled(rng: np.random.Generator) -> np.ndarray:
    cause = RBF(length_scale=0.3, signal_std=1.0)(TIMES, TIMES) + 1e-9 * np.eye(20)
    latent = np.linalg.cholesky(cause) @ rng.normal(size=20)
    return np.stack([latent, -2.0 * latent], axis=1)


def test_diagonal_coregionalisation_is_independent_processes():
    rng = np.random.default_rng(0)
    values, noise = rng.normal(size=(20, 3)), rng.uniform(0.01, 0.1, (20, 3))
    kernels = [RBF(length_scale=0.1 * (q + 1), signal_std=1.0 + q) for q in range(3)]
    joint = CoregionalisedGP(
        terms=tuple(
            Coregionalisation.single(q, 3, kernel) for q, kernel in enumerate(kernels)
        ),
        times=TIMES,
        values=values,
        noise_variance=noise,
    )
    alone = [
        ExactGP(
            kernel=kernel,
            times=TIMES,
            values=values[:, q],
            noise_variance=noise[:, q],
        )
        for q, kernel in enumerate(kernels)
    ]
    for q, process in enumerate(alone):
        np.testing.assert_allclose(
            joint.mean(GRID)[:, q], process.mean(GRID), atol=1e-12
        )
        block = slice(q * len(GRID), (q + 1) * len(GRID))
        np.testing.assert_allclose(
            joint.covariance(GRID)[block, block], process.covariance(GRID), atol=1e-12
        )
    assert joint.log_marginal_likelihood() == pytest.approx(
        sum(process.log_marginal_likelihood() for process in alone), rel=1e-12
    )
    off_diagonal = joint.covariance(GRID)[: len(GRID), len(GRID) :]
    np.testing.assert_allclose(off_diagonal, 0.0, atol=1e-15)


def test_learned_coregionalisation_finds_the_relation():
    values = coupled(np.random.default_rng(1))
    prior = fit_coregionalisation(TIMES, values, np.full((20, 2), 1e-4))
    matrix = prior.matrix
    correlation = matrix[0, 1] / np.sqrt(matrix[0, 0] * matrix[1, 1])
    assert correlation < -0.999
    assert matrix[1, 1] / matrix[0, 0] == pytest.approx(4.0, rel=0.05)


def test_learned_coregionalisation_is_at_a_maximum():
    values, noise = coupled(np.random.default_rng(2)), np.full((20, 2), 1e-2)
    prior = fit_coregionalisation(TIMES, values, noise)

    def value(matrix: np.ndarray, length: float) -> float:
        term = Coregionalisation(
            matrix=matrix, kernel=RBF(length_scale=length, signal_std=1.0)
        )
        return CoregionalisedGP(
            terms=(term,), times=TIMES, values=values, noise_variance=noise
        ).log_marginal_likelihood()

    length = prior.kernel.length_scale
    best = value(prior.matrix, length)
    for change in ([[1.1, 0.0], [0.0, 1.0]], [[1.0, 0.0], [0.0, 0.9]]):
        mixing = np.array(change)
        assert value(mixing @ prior.matrix @ mixing.T, length) < best
    assert value(prior.matrix, 1.1 * length) < best
    assert value(prior.matrix, 0.9 * length) < best


def test_what_is_seen_in_one_output_informs_another():
    values = coupled(np.random.default_rng(3))
    noise = np.full((20, 2), 1e-4)
    noise[10:, 1] = 1e6
    matrix = np.array([[1.0, -2.0], [-2.0, 4.0]])
    term = Coregionalisation(
        matrix=matrix, kernel=RBF(length_scale=0.3, signal_std=1.0)
    )
    joint = CoregionalisedGP(
        terms=(term,), times=TIMES, values=values, noise_variance=noise
    )
    np.testing.assert_allclose(joint.mean(TIMES)[:, 1], values[:, 1], atol=0.1)


def test_indefinite_coregionalisation_is_refused():
    with pytest.raises(ValueError, match=r"symmetric and positive\s+semi-definite"):
        Coregionalisation(
            matrix=np.array([[1.0, 2.0], [2.0, 1.0]]),
            kernel=RBF(length_scale=0.3, signal_std=1.0),
        )
