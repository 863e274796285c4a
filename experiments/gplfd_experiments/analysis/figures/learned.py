"""Figs. 6 and 7, Section IV-A: from recordings to the policy; its plane of the door."""

import dataclasses
import itertools
from typing import Any, Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from scipy.special import chdtri, fdtri

from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_experiments.analysis.figures import style
from gplfd_experiments.analysis.figures.style import Material
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.demonstrations.alignment import align
from gplfd_policies.movements.movement import GaussianTrajectory
from gplfd_policies.movements.skill import fit_skill

OUTPUTS: Final = ("$x$", "$y$", "$z$", "$θu_x$", "$θu_y$", "$θu_z$")
_MAGNIFICATIONS: Final = (20, 10, 5, 2, 1)
X, Z = 0, 2
PLANE: Final = (X, Z)
_PIXELS: Final = 240


def door_colours(radii: tuple[float | None, ...]) -> dict[float | None, str]:
    """Colours of doors by radius, from the smallest; also for no radius."""
    ranked = sorted({radius for radius in radii if radius is not None})
    colours = itertools.chain(style.DOORS, itertools.repeat(style.DOORS[-1]))
    return dict(zip(ranked, colours, strict=False)) | {None: style.DEMONSTRATION}


def fig06(material: Material) -> tuple[Figure, str]:
    """Draw three rows of six panels: demonstrations, aligned, and the policy."""
    labelled = material.demonstrations
    recorded, radii = labelled.demonstrations, labelled.radii
    aligned = (skill := fit_skill(align(recorded))).aligned
    policy = skill.predict(aligned.times)
    colours = door_colours(radii)
    figure = Figure(figsize=(style.PAGE, 3.9), layout="constrained")
    rows = figure.subplots(3, 6, sharey="col", sharex="row")
    # Least and largest value drawn of each output, (6, 2).
    values = np.vstack([*policy.interval(), *(motion.poses for motion in recorded)])
    extents = np.stack([values.min(axis=0), values.max(axis=0)], axis=1)
    for output in range(6):
        for motion, poses, radius in zip(recorded, aligned.poses, radii, strict=True):
            curve = {"color": colours[radius], "linewidth": 0.8}
            times = motion.times - motion.times[0]
            rows[0, output].plot(times, motion.poses[:, output], **curve)
            rows[1, output].plot(aligned.times, poses[:, output], **curve)
        style.mean_and_interval(rows[2, output], policy, output, style.BEFORE)

        # Outputs of a kind share a scale; an enlarged panel states its factor.
        kind = extents[:3] if output < 3 else extents[3:]
        span = 1.08 * float(np.ptp(kind, axis=1).max())
        low, high = extents[output]
        magnified = next(m for m in _MAGNIFICATIONS if m * (high - low) <= span)
        if magnified > 1:
            look: dict[str, Any] = {"fontsize": 6.0, "color": "0.35", "ha": "center"}
            style.note(rows[0, output], 0.5, f"{magnified} × enlarged", **look)
        middle, half = 0.5 * (low + high), 0.5 * span / magnified
        rows[0, output].set_ylim(middle - half, middle + half)
        title = f"{OUTPUTS[output]} [{'m' if output < 3 else 'rad'}]"
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

    # Rms spread between the doors' means over that within doors, of all phases.
    doors = [
        aligned.poses[[radius == door for radius in radii]]
        for door in sorted(set(radii), key=str)
    ]
    within = np.mean([door.var(axis=0) for door in doors], axis=0).mean(axis=0)
    between = np.var([door.mean(axis=0) for door in doors], axis=0).mean(axis=0)
    ratio = np.sqrt(between / within)
    return figure, (
        f"{len(recorded)} demonstrations of opening {len(set(radii))} doors by the "
        "synthetic human: as recorded, aligned by the task completion index, and the "
        "heteroscedastic Gaussian process learned from them with its 95 % interval "
        "(Student t). As in the paper's Fig. 6, the aligned x and z fall into one "
        f"group per door. Spread between doors over spread on one door: {ratio[X]:.0f} "
        f"in x, {ratio[Z]:.0f} in z. Unlike in the paper, θu_y varies no more than the "
        "other rotations, because all doors are opened to nearly one angle."
    )


def squared_radius(degrees_of_freedom: float | None) -> float:
    """Squared Mahalanobis radius of the joint 95 % region of x and z.

    The two-dimensional counterpart of `GaussianTrajectory.interval`: Hotelling's
    2 F(2, ν) with few degrees of freedom, χ²(2) with many.
    """
    if degrees_of_freedom is None:
        return float(chdtri(2, 1.0 - 0.95))
    return 2.0 * float(fdtri(2, degrees_of_freedom, 0.95))


def distance(policy: GaussianTrajectory, points: FloatArray) -> FloatArray:
    """Squared Mahalanobis distance of points (..., 2) [m] from the nearest phase."""
    least = np.full(points.shape[:-1], np.inf)
    for mean, std in zip(policy.mean[:, PLANE], policy.std[:, PLANE], strict=True):
        np.minimum(least, (((points - mean) / std) ** 2).sum(axis=-1), out=least)
    return least


def fig07(material: Material) -> tuple[Figure, str]:
    """Draw the policy's regions, demonstrations and arcs at equal scales."""
    labelled = material.demonstrations
    recorded, radii = labelled.demonstrations, labelled.radii
    skill = fit_skill(align(recorded))
    policy = skill.predict(np.linspace(0.0, 1.0, 201))
    angle = float(np.mean([motion.poses[-1, 4] for motion in recorded]))
    figure = Figure(figsize=(style.COLUMN, 2.85), layout="constrained")
    axes = figure.subplots()
    # The wide region has the quantiles for few demonstrations, the narrow one for many.
    normal = dataclasses.replace(policy, degrees_of_freedom=None)
    for region, name in ((policy, "σ estimated"), (normal, "σ known")):
        # The union of the 95 % regions over all phases, shaded.
        edge = float(np.sqrt(squared_radius(region.degrees_of_freedom)))
        mean, reach = region.mean[:, PLANE], edge * region.std[:, PLANE]
        low, high = (mean - reach).min(axis=0), (mean + reach).max(axis=0)
        margin = 0.02 * (high - low)
        x, z = np.linspace(low - margin, high + margin, _PIXELS).T
        # The root of the distance is nearly linear, so its contours are smooth.
        field = np.sqrt(distance(region, np.stack(np.meshgrid(x, z), axis=-1)))
        levels, tints = [0.0, edge], [style.BEFORE]
        axes.contourf(x, z, field, levels=levels, colors=tints, alpha=0.2)
        axes.contour(x, z, field, levels=[edge], colors=tints, linewidths=0.6)
        # The label is just inside the lower edge.
        lowest = int(np.argmin((mean - reach)[:, 1]))
        place = mean[lowest, 0], (mean - reach)[lowest, 1] + 0.015
        look: dict[str, Any] = {"ha": "center", "fontsize": 6.0, "color": style.MARK}
        axes.text(*place, f"95 %, {name}", **look)
    for poses in skill.aligned.poses:
        axes.plot(*poses[:, PLANE].T, color=style.DEMONSTRATION, linewidth=0.6)
    axes.lines[-1].set_label("demonstrations")
    arcs = {
        radius: handle_pose_on_arc(radius, np.linspace(0.0, angle, 200))[:, PLANE]
        for radius in sorted({radius for radius in radii if radius is not None})
    }
    for radius, path in arcs.items():
        label = f"arc, {radius:.2f} m"
        axes.plot(*path.T, color=door_colours(radii)[radius], label=label)
    axes.plot(*policy.mean[:, PLANE].T, color="black", linestyle=":", label="mean")
    axes.set(xlabel="$x$ [m], along the pull", ylabel="$z$ [m], across it", aspect=1)
    figure.legend(loc="outside upper center", ncols=3)

    from_arcs = distance(policy, np.vstack(list(arcs.values())))
    limits = [squared_radius(free) for free in (policy.degrees_of_freedom, None)]
    wide, narrow = (int((from_arcs <= limit).sum()) for limit in limits)
    return figure, (
        "The policy learned from the demonstrations of Fig. 6 in the plane in which "
        "doors open (the closed handle at the origin): mean, demonstrations, the true "
        "arcs of the doors, and the unions of the joint 95 % regions of x and z over "
        f"all phases: the wide one with Hotelling's quantile for {len(recorded)} "
        "demonstrations, the narrow one for a known spread. The paper's Fig. 7 shows "
        f"one region. Of {from_arcs.size} samples of the arcs, {wide} are inside the "
        f"wide region and {narrow} inside the narrow one. Independent "
        "outputs give an ellipse parallel to the axes at each phase, although x and z "
        "are correlated over the doors."
    )
