"""The sequential comparison: its error over all looks, its power, and its command."""

import itertools
import json
from typing import Any

import numpy as np
import pytest
from scipy.special import beta

from gplfd_experiments.analysis.results.sequential import (
    LEVEL,
    compare,
    e_values,
    rank_payoffs,
    seeds_needed,
)
from gplfd_experiments.cli.main import main
from gplfd_experiments.studies import jobs, runner

STUDIES, SEEDS = 2000, 120


def ever_separated(payoffs):
    """Share of studies that are separated at any of the looks after every seed."""
    return np.mean(np.any(e_values(payoffs) >= 1.0 / LEVEL, axis=-1))


@pytest.mark.parametrize("rate", [0.05, 0.5, 0.9])
def test_equal_rates_are_seldom_separated_however_often_one_looks(rate):
    first, second = np.random.default_rng(0).random((2, STUDIES, SEEDS)) < rate
    payoffs = first.astype(float) - second
    assert ever_separated(payoffs) <= LEVEL


def test_equal_forces_are_seldom_separated():
    """Of a distribution without a mean."""
    first, second = np.random.default_rng(1).standard_cauchy((2, STUDIES, SEEDS))
    assert ever_separated(rank_payoffs(first - second)) <= LEVEL


def test_the_e_value_of_binary_outcomes_is_a_beta_function():
    """∫ (1 + λ)ᵃ (1 − λ)ᵇ dλ / 2 over (−1, 1), to the end of a long study."""
    payoffs = np.random.default_rng(3).choice([-1.0, 0.0, 1.0], 150)
    a, b = np.cumsum(payoffs > 0.0), np.cumsum(payoffs < 0.0)
    expected = 2.0 ** (a + b) * beta(a + 1, b + 1)
    np.testing.assert_allclose(e_values(payoffs), expected, rtol=1e-10)


def test_the_mean_capital_over_all_signs_is_one():
    """The martingale itself, for ranks among the sizes so far, with ties."""
    found = rank_payoffs(np.array([2.0, -1.0, 3.0, 0.0, -2.5]))
    np.testing.assert_allclose(found, [1.0, -1 / 2, 3 / 3, 0.0, -4 / 5])
    sizes = np.array([2.0, 1.0, 1.0, 5.0, 3.0, 0.0, 4.0])
    signs = np.array(list(itertools.product([-1.0, 1.0], repeat=sizes.size)))
    values = e_values(rank_payoffs(signs * sizes))
    np.testing.assert_allclose(values.mean(axis=0), 1.0, rtol=1e-12)


def test_a_separation_stands():
    ones, zeros = [1.0] * 12, [0.0] * 12
    found = compare(ones, zeros, shares=True)
    # 2ⁿ / (n + 1) reaches 20 at n = 8.
    assert (found.separated_at, found.ahead, found.seeds) == (8, 1, 12)
    found = compare(ones + zeros, zeros + ones, shares=True)
    assert (found.separated_at, found.ahead) == (8, 1)
    few = compare(zeros[:7], ones[:7], shares=True)
    assert (few.separated_at, few.ahead) == (None, 0)


def test_seeds_needed_are_those_of_simulated_studies():
    seeds = seeds_needed(0.9, 0.6)
    assert seeds == seeds_needed(0.6, 0.9) == 54
    rng = np.random.default_rng(4)
    first, second = (rng.random((4000, seeds)) < rate for rate in (0.9, 0.6))
    values = e_values(first.astype(float) - second)
    found = np.mean(np.any(values >= 1.0 / LEVEL, axis=1))
    assert found == pytest.approx(0.8, abs=0.025)
    assert seeds_needed(1.0, 0.0) == 8
    assert seeds_needed(0.5, 0.5) is seeds_needed(0.9, 0.8, limit=300) is None
    with pytest.raises(ValueError, match=r"from 0 to 1, got 1\.2, 0\.5"):
        seeds_needed(1.2, 0.5)


# --- The command --------------------------------------------------------------


@pytest.fixture
def study(tmp_path, monkeypatch, episode_result, capsys):
    """Run `gplfd trials --until-separated` on outcomes by policy and seed."""
    metrics = episode_result("gp")["metrics"]
    ran: list[Any] = []

    monkeypatch.chdir(tmp_path)

    def run(outcome: Any, *arguments: str, status: int = 0) -> Any:
        def run_job(job: Any, **_: Any) -> list[Any]:
            ran.extend(job)
            known = jobs.code_state()
            return [
                {"task": task.definition, **known}
                | {"metrics": {**metrics, **outcome(task.policy, task.seed)}}
                for task in job
            ]

        monkeypatch.setattr(runner, "run_job", run_job)
        command = ["trials", "--trials", "stop", "--policies", "gp", "promp"]
        command += ["--until-separated", "--engine", "serial", "--quiet"]
        ran.clear()
        assert main([*command, *arguments]) == status
        return capsys.readouterr(), [(one.policy, one.seed) for one in ran]

    return run


def test_the_command_stops_when_separated_and_goes_on_after_its_limit(study):
    """A winner from the third seed on: nothing is run twice."""

    def outcome(policy, seed):
        return {"success": policy == "gp" or seed < 3}

    said, ran = study(outcome, "--max-seeds", "10")
    # Eight seeds before the first look, then the rest up to the limit.
    assert sorted(ran) == [(name, n) for name in ("gp", "promp") for n in range(10)]
    assert said.out == (
        "10 seeds, doors opened and held, share: gp 1.00, promp 0.30; e-value 16: not "
        "separated (requires 20)\n"
    )
    said, ran = study(outcome, "--json")
    assert sorted(ran) == [(name, n) for name in ("gp", "promp") for n in (10, 11)]
    state = json.loads(said.out)
    assert (state["separated_at"], state["seeds"], state["better"]) == (11, 12, "gp")


def test_a_smaller_force_is_better_and_none_is_no_comparison(study):
    def outcome(policy, seed):
        return {"stop_force_sustained": 20.0 + seed - (policy == "promp")}

    said, _ = study(outcome, "--measure", "stop_force_sustained")
    assert "separated at seed 8, promp is better" in said.out
    said, _ = study(lambda *_: {}, "--measure", "release_speed", "--out", "x", status=2)
    assert "no seed has release_speed of both policies" in said.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--policies", "gp"), "takes two --policies, got ['gp']"),
        (("--policies", "gp", "gp"), "takes two --policies, got ['gp', 'gp']"),
        (("--max-seeds", "7"), "--max-seeds of 8 or more, got 7"),
        (("--measure", "work"), "--measure work is no measure of trial stop, which"),
        (("--part", "small"), "takes neither --part nor --robot"),
    ],
)
def test_what_cannot_be_compared_is_refused(arguments, message, study):
    said, ran = study(lambda *_: {}, *arguments, status=2)
    assert message in said.err
    assert ran == []
    assert main(["trials", "--max-seeds", "50"]) == 2
