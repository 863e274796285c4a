"""How records look to a person who prints them, and where public names are."""

from dataclasses import replace

import numpy as np
import pytest

import gplfd_policies
from gplfd_policies import AlignedDemonstrations, align


def test_a_continued_skill_tells_its_demonstrations_from_what_follows(skill):
    """Five seconds were demonstrated; the skill goes on to seven for larger doors."""
    aligned = replace(skill.aligned, duration=7.0, end=5.0 / 7.0)
    assert repr(replace(skill, aligned=aligned)) == (
        "Skill(6 demonstrations, 200 phases, 5 s, continued to 7 s)"
    )


def test_arrays_have_one_order_in_memory(demonstrations):
    """Sums depend on it: a copy through a file or a pickle must not change them."""
    aligned = align(demonstrations, n_samples=20)
    turned = np.ascontiguousarray(aligned.poses.transpose(1, 2, 0)).transpose(2, 0, 1)
    assert not turned.flags.c_contiguous
    record = AlignedDemonstrations(times=aligned.times, poses=turned)
    assert record.poses.flags.c_contiguous


def test_names_that_are_loaded_when_they_are_used_are_listed():
    assert set(gplfd_policies.__all__) <= set(dir(gplfd_policies))
    with pytest.raises(AttributeError, match="gplfd_policies' has no attribute 'nam'"):
        _ = gplfd_policies.nam
