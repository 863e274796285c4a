"""Infos of numbers alone."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

from gplfd_env.wrappers import FAILURES, REASONS, NumericInfo

pytestmark = pytest.mark.slow

AWAY = np.array([0.6, 0.0, 0.0, 0.0, 0.0, 0.0])
"""So fast that the hand loses the handle."""


def leaves(value: Any) -> Iterator[Any]:
    if isinstance(value, Mapping):
        for inner in value.values():
            yield from leaves(inner)
    else:
        yield value


def test_an_info_holds_numbers_only(make_env):
    plain, coded = make_env("small"), NumericInfo(make_env("small"))
    plain.reset(seed=0)
    _, after = coded.reset(seed=0)
    assert after["failure_code"] == 0
    terminated = False
    while not terminated:
        _, _, terminated, _, before = plain.step(AWAY)
        *_, after = coded.step(AWAY)
        assert all(not isinstance(leaf, str) for leaf in leaves(after))
    assert FAILURES[after["failure_code"]] == before["failure"] == "grasp_lost"
    assert REASONS[after["reason_code"]] == before["reason"]
    assert after["stage_code"] == before["capability"]
    for name in ("failure", "reason", "stage"):
        del before[name], after[f"{name}_code"]
    assert data_equivalence(before, after, exact=True)
