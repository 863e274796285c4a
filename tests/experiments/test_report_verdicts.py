"""What the sentences say follows from the numbers: best, within, beaten."""

import numpy as np
import pytest

from experiments.report.verdicts import rate_verdict, value_verdict
from experiments.results.measures import EPISODE_MEASURES, number_text

FORCE = EPISODE_MEASURES["radial"]


def successes(count, n=20):
    return {f"task {k}": k < count for k in range(n)}


def forces(mean, n=20, spread=0.0):
    noise = np.linspace(-1.0, 1.0, n)
    return {f"task {k}": mean + spread * noise[k] for k in range(n)}


def test_the_best_rate_and_the_next():
    runs = {"gp": successes(20), "kmp": successes(18), "dmp": successes(3)}
    assert rate_verdict("Opened", runs) == (
        "**Opened:** `gp` is best: 20 of 20 (0.84–1.00); next `kmp`, 18 of 20."
    )


def test_equally_best_rates_are_all_named():
    runs = {"gp": successes(20), "promp": successes(20), "kmp": successes(20)}
    assert "`gp` is best together with `kmp`, `promp`" in rate_verdict("Opened", runs)


def test_a_rate_in_the_interval_of_the_best():
    runs = {"gp": successes(17), "kmp": successes(19), "dmp": successes(0)}
    assert rate_verdict("Opened", runs) == (
        "**Opened:** `gp` is within the interval of the best, `kmp`: 17 against 19 of "
        "20 (0.76–0.99)."
    )


def test_a_beaten_rate_names_every_winner_with_its_number():
    runs = {"gp": successes(5), "kmp": successes(20), "promp": successes(15)}
    assert rate_verdict("Opened", runs) == (
        "**Opened:** `gp` is beaten by `kmp` (20 of 20 against 5), `promp` (15 of 20 "
        "against 5)."
    )


def test_rates_are_compared_on_the_tasks_that_both_ran():
    # gp failed only where kmp was never tried.
    runs = {"gp": successes(10), "kmp": successes(10, n=10)}
    assert "is best together with `kmp`: 10 of 20" in rate_verdict("Opened", runs)


def test_who_knows_the_radius_is_not_called_the_best():
    runs = {"gp": successes(5), "oracle": successes(20)}
    assert rate_verdict("Opened", runs).endswith("nothing to compare with.")
    numbers = {"gp": forces(2.0), "oracle": forces(1.0)}
    assert value_verdict(FORCE, numbers).endswith("nothing to compare with.")


def test_a_study_without_the_champion_says_so():
    assert "`gp` is not in this study" in rate_verdict("Opened", {"kmp": successes(1)})
    assert "`gp` has no value" in value_verdict(FORCE, {"kmp": forces(1.0)})


def test_the_best_value_and_the_nearest():
    runs = {"gp": forces(1.5), "kmp": forces(4.0), "promp": forces(2.0)}
    assert value_verdict(FORCE, runs) == (
        "**Peak radial force:** `gp` is best, median 1.5 N; the nearest, `promp`, is "
        "behind by 0.5 N (0.5 to 0.5, n = 20)."
    )


def test_an_equal_value_is_best_too():
    text = value_verdict(FORCE, {"gp": forces(1.5), "gp-fixed": forces(1.5)})
    assert text == (
        "**Peak radial force:** `gp` is best together with `gp-fixed`, median 1.5 N."
    )


def test_a_value_whose_difference_may_be_zero_is_within():
    rival = {task: 1.9 + 2.0 * (-1) ** k for k, task in enumerate(forces(2.0))}
    text = value_verdict(FORCE, {"gp": forces(2.0), "kmp": rival, "dmp": forces(9.0)})
    assert "is within the interval of the best, `kmp`, behind it by 0.1 N (−1" in text


def test_a_beaten_value_names_every_winner_with_its_number():
    runs = {"gp": forces(3.0), "kmp": forces(1.0), "promp": forces(2.5)}
    assert value_verdict(FORCE, runs) == (
        "**Peak radial force:** `gp`, median 3.0 N, is beaten by `kmp` by 2.0 N (2.0 "
        "to 2.0, n = 20); `promp` by 0.5 N (0.5 to 0.5, n = 20)."
    )


def test_few_pairs_settle_nothing():
    runs = {"gp": forces(3.0, n=4), "kmp": forces(1.0, n=4)}
    text = value_verdict(FORCE, runs)
    assert "is behind `kmp` by 2.0 N (n = 4, too few for an interval)" in text
    assert "beaten" not in text
    assert "within" not in text


def test_values_are_compared_on_the_same_tasks():
    easy = {"task 0": 0.5, "task 1": 0.5}
    own = {"task 0": 0.4, "task 1": 0.4, **{f"hard {k}": 9.0 for k in range(9)}}
    assert "`gp` is best, median 9.0 N" in value_verdict(
        FORCE, {"gp": own, "dmp": easy}
    )


@pytest.mark.parametrize("size", ["0.004", "0.04", "0.4"])
def test_a_small_difference_is_not_shown_as_zero(size):
    runs = {"gp": forces(1.0), "kmp": forces(1.0 + float(size))}
    assert f"behind by {size} N ({size} to {size}," in value_verdict(FORCE, runs)


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [(-0.04, 1, "0.0"), (-1.26, 1, "−1.3"), (2.0, 0, "2"), (-0.0, 2, "0.00")],
)
def test_numbers_have_a_typographic_minus_and_no_minus_zero(value, digits, text):
    assert number_text(value, digits) == text
