"""Fig. 6, Section IV-A: from recordings to the policy, for six outputs."""

import itertools
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from gplfd_experiments.analysis.figures import style
from gplfd_experiments.analysis.figures.material import Material
from gplfd_policies.demonstrations.alignment import align
from gplfd_policies.demonstrations.npz import LabelledDemonstrations
from gplfd_policies.movements.movement import GaussianTrajectory
from gplfd_policies.movements.skill import Skill, fit_skill

TITLE: Final = "From demonstrations to a policy, output by output"
DOORS: Final = ()
OUTPUTS: Final = ("$x$", "$y$", "$z$", "$θu_x$", "$θu_y$", "$θu_z$")
UNITS: Final = ("m", "m", "m", "rad", "rad", "rad")
_MAGNIFICATIONS: Final = (20, 10, 5, 2, 1)


@dataclass(frozen=True, kw_only=True, slots=True)
class Learning:
    """Data of Fig. 6: demonstrations, aligned demonstrations, learned policy."""

    recorded: LabelledDemonstrations
    skill: Skill
    policy: GaussianTrajectory

    def spread_between_doors(self, output: int) -> tuple[float, float]:
        """Rms spread between the doors' means and within doors, over phases."""
        poses, radii = self.skill.aligned.poses[:, :, output], self.recorded.radii
        doors = [
            poses[[radius == door for radius in radii]]
            for door in sorted(set(radii), key=str)
        ]
        within = np.mean([door.var(axis=0) for door in doors])
        between = np.var([door.mean(axis=0) for door in doors], axis=0).mean()
        return float(np.sqrt(between)), float(np.sqrt(within))


def measure(material: Material) -> Learning:
    """Align the demonstrations and learn from them."""
    recorded = material.demonstrations
    skill = fit_skill(align(recorded.demonstrations))
    policy = skill.predict(skill.aligned.times)
    return Learning(recorded=recorded, skill=skill, policy=policy)


def draw(shown: Learning) -> Figure:
    """Draw three rows of six panels."""
    figure = style.new_figure(style.PAGE, 3.9)
    rows = figure.subplots(3, 6, sharey="col", sharex="row")
    radii = shown.recorded.radii
    colours = door_colours(radii)
    aligned = shown.skill.aligned
    # Least and largest value drawn of each output, (6, 2).
    drawn = [demonstration.poses for demonstration in shown.recorded.demonstrations]
    values = np.vstack([*shown.policy.interval(), *drawn])
    extents = np.stack([values.min(axis=0), values.max(axis=0)], axis=1)
    for output in range(6):
        for recorded, poses, radius in zip(
            shown.recorded.demonstrations, aligned.poses, radii, strict=True
        ):
            times = recorded.times - recorded.times[0]
            curve = {"color": colours[radius], "linewidth": 0.8}
            rows[0, output].plot(times, recorded.poses[:, output], **curve)
            rows[1, output].plot(aligned.times, poses[:, output], **curve)
        style.mean_and_interval(rows[2, output], shown.policy, output, style.BEFORE)

        # Outputs of a kind share a scale; an enlarged panel states its factor.
        kind = extents[:3] if output < 3 else extents[3:]
        span = 1.08 * float(np.ptp(kind, axis=1).max())
        low, high = extents[output]
        magnified = next(m for m in _MAGNIFICATIONS if m * (high - low) <= span)
        if magnified > 1:
            text = f"{magnified} × enlarged"
            look: dict[str, Any] = {"fontsize": 6.0, "color": "0.35", "ha": "center"}
            style.note(rows[0, output], 0.5, text, **look)
        middle, half = 0.5 * (low + high), 0.5 * span / magnified
        rows[0, output].set_ylim(middle - half, middle + half)
        title = f"{OUTPUTS[output]} [{UNITS[output]}]"
        rows[0, output].set(title=title, xlabel="time [s]")
        rows[2, output].set_xlabel("phase")
    for row, text in zip(rows, ("recorded", "aligned", "policy, 95 %"), strict=True):
        row[0].set_ylabel(text, fontsize=7.5, fontweight="bold")
    rows[0, 0].set_xlim(0.0, None)
    for row in rows[1:]:
        row[0].set_xlim(0.0, 1.0)
        row[0].set_xticks([0.0, 0.5, 1.0], ["0", "0.5", "1"])
    entries: dict[str, Artist] = {}
    for line, radius in zip(rows[0, 0].lines, radii, strict=True):
        name = "unknown radius" if radius is None else f"door of {radius:.2f} m"
        entries.setdefault(name, line)
    style.legend_above(figure, entries)
    return figure


def door_colours(radii: tuple[float | None, ...]) -> dict[float | None, str]:
    """Colours of doors by radius, from the smallest; also for no radius."""
    ranked = sorted({radius for radius in radii if radius is not None})
    colours = itertools.chain(style.DOORS, itertools.repeat(style.DOORS[-1]))
    return dict(zip(ranked, colours, strict=False)) | {None: style.DEMONSTRATION}


def caption(shown: Learning) -> str:
    """Describe the figure and state its numbers."""
    (x_between, x_within), (z_between, z_within) = map(
        shown.spread_between_doors, (0, 2)
    )
    largest = 1e3 * shown.policy.std.max(axis=0)
    listed = ", ".join(
        f"{name.strip('$')} {std:.0f} m{unit}"
        for name, std, unit in zip(OUTPUTS, largest, UNITS, strict=True)
    )
    return (
        f"{len(shown.recorded.demonstrations)} demonstrations of opening "
        f"{len(set(shown.recorded.radii))} doors by the synthetic human: as recorded, "
        "aligned by the task completion index, and the heteroscedastic Gaussian "
        "process learned from them with its 95 % interval (Student t). Positions share "
        "one scale and rotations another, except where a panel says how much it is "
        "enlarged. As in the paper's Fig. 6, the aligned x and z fall into one group "
        f"per door. Largest standard deviation: {listed}. Spread between doors over "
        f"spread on one door: {x_between / x_within:.0f} in x, "
        f"{z_between / z_within:.0f} in z. Unlike in the paper, θu_y varies no more "
        "than the other rotations, because all doors are opened to nearly one angle."
    )
