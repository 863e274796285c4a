"""What a step of many simulations came to, stacked."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gplfd_env.conventions.resets import masked
from gplfd_env.task.episode import Episode
from gplfd_env.task.info import BASE_POSE, BASE_RATE, FLAGS, NUMBERS, POSE, TEXTS

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Info = dict[str, Any]


def outcome(
    episodes: Sequence[Episode], limit: float, rows: Mask
) -> tuple[Array, Mask, Mask, Info]:
    """Return rewards, terminations, truncations, and infos with masks.

    Args:
        episodes: Of all simulations.
        limit: Control periods after which one is truncated.
        rows: Which of them the infos are of, (n,).
    """
    # One array of everything: at small n an array costs as much as ten numbers.
    columns = np.array(
        [
            (*e.row, e.terminated, e.steps >= limit, *e.terms.values(), e.reward)
            for e in episodes
        ]
    ).T
    flags_end = BASE_RATE.stop + len(FLAGS) + 2
    *flags, terminations, late = columns[BASE_RATE.stop : flags_end] > 0.0
    infos: Info = dict(zip(NUMBERS, columns, strict=False))
    infos["capability"] = infos["capability"].astype(np.int64)
    infos["handle_pose"] = columns[POSE].T
    infos["base_pose"] = columns[BASE_POSE].T
    infos["base_velocity"] = columns[BASE_RATE].T
    infos.update(zip(FLAGS, flags, strict=True))
    for name in TEXTS:
        each = [getattr(one, name) for one in episodes]
        infos[name] = np.array(each, dtype=object)
    *terms, rewards = columns[flags_end:]
    named = dict(zip(episodes[0].terms, terms, strict=True))
    infos["reward_terms"] = named
    truncations = infos["simulation_error"] | late
    return rewards, terminations, truncations, masked(infos, rows)
