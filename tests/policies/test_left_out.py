"""The wobble of deviations, chosen by leaving a demonstration out."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import invwishart
from scipy.stats import t as student

from gplfd_policies.gp.deviations import (
    MODEL_WORTH,
    DeviationProcess,
    conjugate_share,
    forecast_score,
    wobbling,
)

TIMES = np.linspace(0.0, 1.0, 30)
PROCESS = DeviationProcess(
    wobble=1e-6, varying=0.4, white=0.1, long_scale=0.6, short_scale=0.2
)


def wandering(count, seed):
    """Curves that start apart and wander on, (count, 30, 6)."""
    rng = np.random.default_rng(seed)
    scale = np.exp(-0.5 * (np.subtract.outer(TIMES, TIMES) / 0.15) ** 2)
    root = np.linalg.cholesky(scale + 1e-9 * np.eye(30))
    wobble = np.einsum("mn,kni->kmi", root, rng.normal(size=(count, 30, 6)))
    curves = 0.03 * rng.normal(size=(count, 1, 6)) + 0.02 * wobble
    return curves - curves.mean(axis=0)


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_score_is_that_of_forecasts_one_by_one(share):
    """Poses, means of the others and conditional distributions written out."""
    noise = np.full(30, 1e-3)
    smooth, white = PROCESS.smooth_covariance(TIMES, noise), PROCESS.white * noise
    curves = wandering(5, 0)[:, :, 0]
    scores = []
    for place, curve in enumerate(curves):
        others = np.delete(curves, place, axis=0)
        error = curve - others.mean(axis=0)
        covariance = (1.0 - share) * smooth + share * np.cov(others, rowvar=False)
        covariance = 1.25 * covariance
        white_part = np.diag(white + 1e-6 * np.diag(smooth))
        for start in (6, 10, 15):
            gram = (covariance + white_part)[:start, :start]
            gain = np.linalg.solve(gram, covariance[:start, start:])
            rest = error[start:] - error[:start] @ gain
            variance = np.diag((covariance + white_part)[start:, start:])
            variance = variance - np.sum(covariance[:start, start:] * gain, axis=0)
            density = student.logpdf(rest, 4.0, scale=np.sqrt(variance))
            scores.append((start, np.mean(density)))
    expected = np.mean([mean for _, mean in scores])
    score = forecast_score(smooth, white, curves, share)
    assert score == pytest.approx(expected, rel=1e-9)


def test_wobble_is_what_forecasts_left_out_demonstrations_best():
    """Told that curves hardly wobble, all outputs get the one factor that forecasts."""
    curves, noise = wandering(8, 1), np.full((30, 6), 1.3e-3)
    chosen = wobbling([PROCESS] * 6, TIMES, curves, noise)
    factors = {p.wobble / PROCESS.wobble for p in chosen}
    assert len(factors) == 1
    factor = factors.pop()
    assert factor > 16.0
    assert chosen[0] == replace(PROCESS, wobble=chosen[0].wobble)

    def score(wobble):
        process = replace(PROCESS, wobble=wobble)
        smooth = process.smooth_covariance(TIMES, noise[:, 0])
        white = process.white_variance(noise[:, 0])
        return sum(
            forecast_score(smooth, white, curves[:, :, output], conjugate_share(8))
            for output in range(6)
        )

    best = score(factor * PROCESS.wobble)
    assert best > score(PROCESS.wobble)
    assert best >= score(0.5 * factor * PROCESS.wobble)


def test_mixed_covariance_is_the_mean_of_the_inverse_wishart_posterior():
    """By weighing 150,000 covariances drawn a priori with the likelihood."""
    worth, count = float(MODEL_WORTH), 6
    model = np.array([[2.0, 0.6], [0.6, 1.0]])
    rng = np.random.default_rng(0)
    deviations = rng.multivariate_normal([0.0, 0.0], [[1.0, -0.5], [-0.5, 1.5]], 5)
    scatter = deviations.T @ deviations
    prior = invwishart(df=worth + 3.0, scale=worth * model)
    drawn = prior.rvs(150_000, random_state=rng)
    inverse = np.linalg.inv(drawn)
    log_likelihood = 0.5 * (count - 1) * np.linalg.slogdet(inverse)[1]
    log_likelihood -= 0.5 * np.einsum("nij,ji->n", inverse, scatter)
    weights = np.exp(log_likelihood - log_likelihood.max())
    expected = np.einsum("n,nij->ij", weights / weights.sum(), drawn)
    share = conjugate_share(count)
    mixed = (1.0 - share) * model + share * scatter / (count - 1)
    assert_allclose(mixed, expected, atol=0.01)


def test_share_of_the_demonstrations_grows_with_their_number():
    shares = [conjugate_share(count) for count in (1, 2, 3, 6, 12, 1000)]
    assert shares[0] == 0.0
    assert shares == sorted(shares)
    assert shares[-1] > 0.98
    # As many independent deviations as the model is worth have half of the say.
    assert conjugate_share(12) < 0.5 < conjugate_share(13)
