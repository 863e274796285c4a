"""How well the force of a left-out demonstration is predicted.

Its wrenches take the place of its poses, in the axes of the hand, as
`gplfd_policies.movements.movement.LearnedMovement.forces` has them.
"""

import numpy as np

from gplfd_env.spatial.se3 import into_axes
from gplfd_experiments.studies.learning_tests.accuracy import known, root_mean_square
from gplfd_experiments.studies.learning_tests.folds import OnPhases
from gplfd_experiments.studies.learning_tests.via_points import FORECASTS, observed
from gplfd_policies.control.compliance import ComplianceConfig
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.movements.movement import LearnedMovement, Movement
from gplfd_policies.movements.trajectory import GaussianTrajectory
from gplfd_policies.registry.method import Method

_SAMPLES = 200


def force_scores(
    method: Method, movement: Movement, left_out: OnPhases, one: Demonstration
) -> dict[str, float | None]:
    """Return the accuracy of the force at a demonstration, which the phases are of.

    First of the whole, before any force was measured; then of the rest, once a share of
    `FORECASTS` was measured. Empty where no forces were learned or none recorded.
    """
    learned = movement.forces if isinstance(movement, LearnedMovement) else None
    if learned is None or one.wrenches is None:
        return {}
    rotations = one.poses[:, None, 3:]
    apart = into_axes(rotations, one.wrenches.reshape(-1, 2, 3))
    felt = OnPhases(phases=left_out.phases, poses=apart.reshape(-1, 6))
    asked = felt.thinned(_SAMPLES)
    scores = _scores("force", learned.predict(asked.phases), asked.poses)
    form = method.force_adaptation or method.adaptation
    noise = np.repeat(np.array(ComplianceConfig().force_std), 3)
    for share in FORECASTS:
        rest, truth, _ = observed(form, learned, felt, share, noise)
        scores |= _scores(f"forecast_{100 * share:.0f}_force", rest, truth)
    return scores


def _scores(
    name: str, predicted: GaussianTrajectory, truth: np.ndarray
) -> dict[str, float | None]:
    error = np.linalg.norm((predicted.mean - truth)[:, :3], axis=1)
    return {
        f"{name}_error_n": root_mean_square(error),
        f"{name}_nlpd": known(predicted.nlpd(truth)),
        f"{name}_coverage_95": known(predicted.coverage(truth, normal=True)),
    }
