"""What the sentences say follows from the numbers: best, within, beaten."""

import pytest

from gplfd_experiments.analysis.report.sentences import rate_sentence, value_sentence
from gplfd_experiments.analysis.results.measures import EPISODE_MEASURES, number_text

FORCE = EPISODE_MEASURES["force_radial_peak"]
MINE = "my_module:make"


def opened(count, n=20):
    return {(k, "task"): k < count for k in range(n)}


def forces(mean, n=20):
    return {(k, "task"): mean for k in range(n)}


@pytest.mark.parametrize(
    ("runs", "said"),
    [
        (
            {"gp": opened(20), "kmp": opened(18), "dmp": opened(3)},
            "`gp`, 20 of 20 (0.84–1.00), is best; next is `kmp`, 18 of 20 (0.70–0.97) "
            "against 20.",
        ),
        (
            {"gp": opened(20), "promp": opened(20), "kmp": opened(20)},
            "`gp`, 20 of 20 (0.84–1.00), is best together with `kmp`, `promp`.",
        ),
        (
            {"gp": opened(17), "kmp": opened(19), "dmp": opened(0)},
            "`gp`, 17 of 20 (0.64–0.95), is within the interval of the best, `kmp`, 19 "
            "of 20 (0.76–0.99) against 17.",
        ),
        (
            {"gp": opened(5), "kmp": opened(20), "promp": opened(15)},
            "`gp`, 5 of 20 (0.11–0.47), is beaten by `kmp`, 20 of 20 (0.84–1.00) "
            "against 5; `promp`, 15 of 20 (0.53–0.89) against 5.",
        ),
        # gp failed only where kmp was never tried.
        (
            {"gp": opened(10), "kmp": opened(10, n=10)},
            "`gp`, 10 of 20 (0.30–0.70), is best together with `kmp`.",
        ),
        # The oracle knows the radius, and is not called the best.
        (
            {"gp": opened(5), "oracle": opened(20)},
            "`gp`, 5 of 20 (0.11–0.47), has nothing to compare with.",
        ),
        ({"kmp": opened(1)}, "`gp` has no episode that ran."),
        # Policies that opened nothing are not ranked.
        (
            {"gp": opened(0), "kmp": opened(5), "dmp": opened(0)},
            "`gp` opened none of 20; `kmp` opened most, 5 of 20 (0.11–0.47) against 0.",
        ),
        (
            {"gp": opened(5), "dmp": opened(0)},
            "`gp`, 5 of 20 (0.11–0.47); no other policy opened a door.",
        ),
        (
            {"gp": opened(0), "dmp": opened(0)},
            "`gp` opened none of 20; nor did any other policy.",
        ),
    ],
)
def test_rates(runs, said):
    assert rate_sentence("Opened", runs, "gp") == f"**Opened:** {said}"
    # Any policy may be the one that is compared.
    renamed = {MINE if name == "gp" else name: own for name, own in runs.items()}
    expected = f"**Opened:** {said}".replace("`gp`", f"`{MINE}`")
    assert rate_sentence("Opened", renamed, MINE) == expected


EASY = {(0, "easy"): 0.5, (1, "easy"): 0.5}
HARD = {(0, "easy"): 0.4, (1, "easy"): 0.4, **{(k, "hard"): 9.0 for k in range(9)}}
SCATTERED = {task: 1.9 + 2.0 * (-1) ** k for k, task in enumerate(forces(2.0))}


@pytest.mark.parametrize(
    ("runs", "said"),
    [
        (
            {"gp": forces(1.5), "kmp": forces(4.0), "promp": forces(2.0)},
            "1.5 N, is best; next is `promp`, behind by 0.5 N (0.5 to 0.5, 20 seeds).",
        ),
        (
            {"gp": forces(1.5), "gp-fixed": forces(1.5)},
            "1.5 N, is best together with `gp-fixed`.",
        ),
        (
            {"gp": forces(2.0), "kmp": SCATTERED, "dmp": forces(9.0)},
            "2.0 N, is within the interval of the best, `kmp`, ahead by 0.1 N (−1.9 to "
            "2.1, 20 seeds).",
        ),
        (
            {"gp": forces(3.0), "kmp": forces(1.0), "promp": forces(2.5)},
            "3.0 N, is beaten by `kmp`, ahead by 2.0 N (2.0 to 2.0, 20 seeds); "
            "`promp`, ahead by 0.5 N (0.5 to 0.5, 20 seeds).",
        ),
        # Few pairs settle nothing.
        (
            {"gp": forces(3.0, n=4), "kmp": forces(1.0, n=4)},
            "3.0 N, may be beaten by `kmp`, ahead by 2.0 N (too few for an interval, 4 "
            "seeds).",
        ),
        # Values are compared on the same tasks.
        (
            {"gp": HARD, "dmp": EASY},
            "9.0 N, is best; next is `dmp`, behind by 0.1 N (too few for an interval, "
            "2 seeds).",
        ),
        # A small difference is not shown as zero.
        *(
            (
                {"gp": forces(1.0), "kmp": forces(1.0 + float(size))},
                f"1.0 N, is best; next is `kmp`, behind by {size} N ({size} to {size}, "
                "20 seeds).",
            )
            for size in ("0.004", "0.04", "0.4")
        ),
    ],
)
def test_values(runs, said):
    expected = f"**Peak radial force:** `gp`, median {said}"
    assert value_sentence(FORCE, runs, "gp") == expected


@pytest.mark.parametrize(
    "runs",
    [
        {"gp": forces(2.0), "oracle": forces(1.0)},
        {"kmp": forces(1.0)},
        # Tasks that only one of them ran.
        {"gp": forces(1.0), "kmp": {(99, "another"): 1.0}},
    ],
)
def test_nothing_is_said_of_values_that_nobody_can_be_compared_with(runs):
    assert value_sentence(FORCE, runs, "gp") == ""


def test_numbers_have_a_typographic_minus_and_no_minus_zero():
    cases = {(-0.04, 1): "0.0", (-1.26, 1): "−1.3", (2.0, 0): "2", (-0.0, 2): "0.00"}
    assert {given: number_text(*given) for given in cases} == cases
