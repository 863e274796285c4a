"""Numbers of configuration records: ranges, open ends, whole ones, messages."""

import math
from dataclasses import astuple, dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gplfd_env.validation.fields import (
    Range,
    allowed_range,
    check_choice,
    check_quantities,
    checked_count,
    quantity,
)


@dataclass(frozen=True, kw_only=True, slots=True)
class Swing:
    """One field of each kind."""

    length: float = quantity(1.0, unit="m", low=0.5, high=2.0, reason="the room")
    damping: float = quantity(0.1, unit="N m s/rad", above=0.0)
    overlap: float = quantity(0.5, above=0.0, below=1.0)
    share: float = quantity(0.0, low=0.0, below=1.0)
    turns: int = quantity(3, unit="turns", low=1, high=9)
    seats: int = quantity(1, low=1)
    name: str = "swing"

    def __post_init__(self) -> None:
        check_quantities(self)


def test_values_become_plain_numbers_and_stay():
    swing = Swing(length=np.float32(0.5), turns=np.int8(9), damping=3)
    types = [type(value) for value in astuple(swing)]
    assert types == [*4 * [float], *2 * [int], str]
    assert (swing.length, swing.turns, swing.damping) == (0.5, 9, 3.0)
    declared = allowed_range(Swing, "length")
    assert (declared.low, declared.high, declared.unit) == (0.5, 2.0, "m")


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("length", 2.5, "Swing.length = 2.5 is outside [0.5, 2] m (the room)"),
        ("damping", math.inf, "Swing.damping = inf is outside (0, inf) N m s/rad"),
        ("overlap", 1.0, "Swing.overlap = 1.0 is outside (0, 1)"),
        ("share", 1.0, "Swing.share = 1.0 is outside [0, 1)"),
        ("turns", 2.0, "Swing.turns = 2.0 must be a whole number of turns from 1 to 9"),
        ("seats", True, "Swing.seats = True must be a whole number from 1"),
    ],
)
def test_what_is_not_allowed_is_named_with_what_is(field, value, message):
    with pytest.raises(ValueError, match="Swing") as error:
        Swing(**{field: value})
    assert str(error.value) == message


@pytest.mark.parametrize("value", ["1", None, True])
def test_other_types_are_refused(value):
    with pytest.raises(TypeError, match=r"Swing\.length must be a number, got "):
        Swing(length=value)


@given(value=st.floats(), low=st.floats(-9, 0), high=st.floats(0, 9))
def test_open_ends_are_outside_and_closed_ones_inside(value, low, high):
    assert (value in Range(low=low, high=high)) == (low <= value <= high)
    assert (value in Range(above=low, below=high)) == (low < value < high)
    assert (value in Range()) == math.isfinite(value)


def test_counts_and_choices_among_arguments():
    assert checked_count("width", np.int64(64), Range(low=1)) == 64
    check_choice("reward", None, (None, "dense"))
    with pytest.raises(ValueError, match="reward = 'x' is not one of None, 'dense'"):
        check_choice("reward", "x", (None, "dense"))
