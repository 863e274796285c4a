"""What the settings of controller, phase and handles refuse, and how they say it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from gplfd_policies import AgentStep
from gplfd_policies.control.compliance import ComplianceConfig
from gplfd_policies.control.load import CarriedLoad, LearnedLoad
from gplfd_policies.control.rendering import ArmRendering
from gplfd_policies.control.stiffness import (
    DEFAULT_PROFILE,
    PAPER_DYNAMICS,
    PAPER_PROFILE,
)
from gplfd_policies.demonstrations.path_similarity import SimilarityConfig
from gplfd_policies.phase.phase_rule import PathPhaseConfig

ONES, NAN = np.ones(6), np.nan
ACTIONS = np.arange(18.0).reshape(3, 6)
STEP = AgentStep(action=ONES)
IN_ARM = ComplianceConfig(rendering=ArmRendering, stiffness_frame="axes")
SOFT = replace(DEFAULT_PROFILE, k_min=np.full(6, 5.0))
UNEVEN = replace(PAPER_DYNAMICS, mass=np.arange(1.0, 7.0))
NUMBERS = [
    (LearnedLoad, "limit", 0.0),
    (ComplianceConfig, "control_period", 0.0),
    (PathPhaseConfig, "position_noise", -1e-3),
    (SimilarityConfig, "spacing", 0.0),
]


@pytest.mark.parametrize(("record", "name", "value"), NUMBERS)
def test_a_number_outside_its_range_is_refused(record, name, value):
    message = rf"^{record.__name__}\.{name} = {value} is outside [\[(]"
    with pytest.raises(ValueError, match=message):
        record(**{name: value})


@pytest.mark.usefixtures("as_for_users")
@pytest.mark.parametrize(
    ("record", "changes", "message"),
    [
        (CarriedLoad(), {"limit": 0.0}, r"to carry nothing use YieldToAll"),
        (LearnedLoad(), {"least": 30.0}, r"least must not exceed limit, got 30"),
        (PathPhaseConfig(), {"window": (0.1, NAN)}, "window must be two finite"),
        (ComplianceConfig(), {"via_std": (-1e-3, 0.0)}, r"Config\.via_std must be two"),
        (ComplianceConfig(), {"load": object()}, r"Config\.load must be a load rule"),
        (IN_ARM, {"profile": SOFT}, r"asks for \[5\. 5\..* from \[20\. 20\."),
        (ComplianceConfig(), {"rendering": ArmRendering}, "along the task's axes"),
        (ComplianceConfig(), {"stiffness_frame": "door"}, "'door' is not one of"),
        (ComplianceConfig(), {"dynamics": UNEVEN}, r"dynamics\.mass must be the same"),
        (PAPER_PROFILE, {"k_min": np.full(6, 501.0)}, "0 < k_min <= k_max"),
        (PAPER_PROFILE, {"alpha": np.zeros(6)}, "set k_min = k_max"),
        (PAPER_DYNAMICS, {"mass": np.zeros(6)}, "mass must be positive"),
        (PAPER_DYNAMICS, {"least_damping": -ONES}, "least_damping not negative"),
        (STEP, {"action": np.zeros(3)}, r"AgentStep\.action .* \(6,\), got \(3,\)"),
        (STEP, {"action": math.nan}, r"AgentStep\.action .* \(6,\), got \(\)"),
        (AgentStep(action=ACTIONS), {"std": ONES}, r"\.std .* \(3, 6\), got \(6,\)"),
    ],
)
def test_an_unusable_setting_is_refused(record, changes, message):
    with pytest.raises(ValueError, match=message):
        replace(record, **changes)


def test_an_arm_is_not_commanded_a_stiffness_along_other_directions():
    turned = replace(STEP, frame=np.eye(3)[::-1], stiffness=ONES)
    assert_array_equal(turned.command("pose"), ONES)
    with pytest.raises(ValueError, match=r"leave AgentStep\.frame out"):
        turned.command("impedance")
