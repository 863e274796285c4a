"""What the sentences say follows from the numbers: best, within, beaten."""

import numpy as np
import pytest

from gplfd_experiments.analysis.report import sentences
from gplfd_experiments.analysis.results.measures import EPISODE_MEASURES, number_text

FORCE = EPISODE_MEASURES["force_radial_peak"]


def successes(count, n=20):
    return {(k, "task"): k < count for k in range(n)}


def forces(mean, n=20, spread=0.0):
    noise = np.linspace(-1.0, 1.0, n)
    return {(k, "task"): mean + spread * noise[k] for k in range(n)}


def rate(runs, reference="gp"):
    return sentences.rate_sentence("Opened", runs, reference)


def value(runs, reference="gp"):
    return sentences.value_sentence(FORCE, runs, reference)


def test_the_best_rate_and_the_next():
    runs = {"gp": successes(20), "kmp": successes(18), "dmp": successes(3)}
    assert rate(runs) == (
        "**Opened:** `gp`, 20 of 20 (0.84–1.00), is best; next is `kmp`, 18 of 20 "
        "(0.70–0.97) against 20."
    )


def test_equally_best_rates_are_all_named():
    runs = {"gp": successes(20), "promp": successes(20), "kmp": successes(20)}
    assert rate(runs).endswith("is best together with `kmp`, `promp`.")


def test_a_rate_in_the_interval_of_the_best():
    runs = {"gp": successes(17), "kmp": successes(19), "dmp": successes(0)}
    assert rate(runs) == (
        "**Opened:** `gp`, 17 of 20 (0.64–0.95), is within the interval of the best, "
        "`kmp`, 19 of 20 (0.76–0.99) against 17."
    )


def test_a_beaten_rate_names_every_winner_with_its_number():
    runs = {"gp": successes(5), "kmp": successes(20), "promp": successes(15)}
    assert rate(runs).endswith(
        "is beaten by `kmp`, 20 of 20 (0.84–1.00) against 5; `promp`, 15 of 20 "
        "(0.53–0.89) against 5."
    )


def test_any_policy_may_be_the_one_that_is_compared():
    runs = {"gp": successes(20), "my_module:make": successes(5)}
    assert rate(runs, "my_module:make").startswith(
        "**Opened:** `my_module:make`, 5 of 20 (0.11–0.47), is beaten by `gp`, 20 of 20"
    )
    numbers = {"gp": forces(2.0), "my_module:make": forces(1.0)}
    assert "`my_module:make`, median 1.0 N, is best; next is `gp`" in value(
        numbers, "my_module:make"
    )


def test_rates_are_compared_on_the_tasks_that_both_ran():
    # gp failed only where kmp was never tried.
    runs = {"gp": successes(10), "kmp": successes(10, n=10)}
    assert "`gp`, 10 of 20 (0.30–0.70), is best together with `kmp`" in rate(runs)


def test_who_knows_the_radius_is_not_called_the_best():
    runs = {"gp": successes(5), "oracle": successes(20)}
    assert rate(runs).endswith("has nothing to compare with.")
    numbers = {"gp": forces(2.0), "oracle": forces(1.0)}
    assert value(numbers) == ""


def test_a_reference_without_numbers_says_so():
    assert "`gp` has no episode that ran" in rate({"kmp": successes(1)})
    assert value({"kmp": forces(1.0)}) == ""


def test_who_opened_nothing_is_not_ranked():
    none = rate({"gp": successes(0), "kmp": successes(5), "dmp": successes(0)})
    assert "`gp` opened none of 20; `kmp` opened most, 5 of 20" in none
    assert "`dmp`" not in none
    alone = rate({"gp": successes(5), "dmp": successes(0)})
    assert "`gp`, 5 of 20" in alone
    assert alone.endswith("no other policy opened a door.")
    nobody = rate({"gp": successes(0), "dmp": successes(0)})
    assert nobody.endswith("`gp` opened none of 20; nor did any other policy.")


def test_the_best_value_and_the_nearest():
    runs = {"gp": forces(1.5), "kmp": forces(4.0), "promp": forces(2.0)}
    assert value(runs) == (
        "**Peak radial force:** `gp`, median 1.5 N, is best; next is `promp`, behind "
        "by 0.5 N (0.5 to 0.5, 20 seeds)."
    )


def test_an_equal_value_is_best_too():
    text = value({"gp": forces(1.5), "gp-fixed": forces(1.5)})
    assert text == (
        "**Peak radial force:** `gp`, median 1.5 N, is best together with `gp-fixed`."
    )


def test_a_value_whose_difference_may_be_zero_is_within():
    rival = {task: 1.9 + 2.0 * (-1) ** k for k, task in enumerate(forces(2.0))}
    text = value({"gp": forces(2.0), "kmp": rival, "dmp": forces(9.0)})
    assert "is within the interval of the best, `kmp`, ahead by 0.1 N (−1" in text


def test_a_beaten_value_names_every_winner_with_its_number():
    runs = {"gp": forces(3.0), "kmp": forces(1.0), "promp": forces(2.5)}
    assert value(runs) == (
        "**Peak radial force:** `gp`, median 3.0 N, is beaten by `kmp`, ahead by 2.0 N "
        "(2.0 to 2.0, 20 seeds); `promp`, ahead by 0.5 N (0.5 to 0.5, 20 seeds)."
    )


def test_few_pairs_settle_nothing():
    text = value({"gp": forces(3.0, n=4), "kmp": forces(1.0, n=4)})
    assert text.endswith(
        "may be beaten by `kmp`, ahead by 2.0 N (too few for an interval, 4 seeds)."
    )
    assert "is beaten" not in text
    assert "within" not in text


def test_values_are_compared_on_the_same_tasks():
    easy = {(0, "easy"): 0.5, (1, "easy"): 0.5}
    own = {(0, "easy"): 0.4, (1, "easy"): 0.4}
    own |= {(k, "hard"): 9.0 for k in range(9)}
    assert "`gp`, median 9.0 N, is best" in value({"gp": own, "dmp": easy})


@pytest.mark.parametrize("size", ["0.004", "0.04", "0.4"])
def test_a_small_difference_is_not_shown_as_zero(size):
    runs = {"gp": forces(1.0), "kmp": forces(1.0 + float(size))}
    assert f"behind by {size} N ({size} to {size}," in value(runs)


@pytest.mark.parametrize(
    ("number", "digits", "text"),
    [(-0.04, 1, "0.0"), (-1.26, 1, "−1.3"), (2.0, 0, "2"), (-0.0, 2, "0.00")],
)
def test_numbers_have_a_typographic_minus_and_no_minus_zero(number, digits, text):
    assert number_text(number, digits) == text
