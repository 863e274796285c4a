"""Fig. 7, Section IV-A: the policy in the plane in which doors open."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.special import chdtri, fdtri

from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_experiments.analysis.figures import style
from gplfd_experiments.analysis.figures.fig06_policy import door_colours
from gplfd_experiments.analysis.figures.material import Material
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.demonstrations.alignment import align
from gplfd_policies.demonstrations.npz import LabelledDemonstrations
from gplfd_policies.movements.movement import GaussianTrajectory
from gplfd_policies.movements.skill import Skill, fit_skill

TITLE: Final = "The policy on the plane of the door"
DOORS: Final = ()
X, Z = 0, 2
PLANE: Final = (X, Z)
_PHASES: Final = np.linspace(0.0, 1.0, 201)
_PIXELS: Final = 240
_ARC_SAMPLES: Final = 200


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


@dataclass(frozen=True, kw_only=True, slots=True)
class Region:
    """Data of Fig. 7."""

    demonstrations: LabelledDemonstrations
    skill: Skill
    policy: GaussianTrajectory
    arcs: Mapping[float, FloatArray]
    """True paths (200, 2) of the demonstrated doors' handles [m], to the mean angle, by
    radius [m]."""
    arc_inside: tuple[float, float]
    """Share of the arcs' samples inside the 95 % region of any phase: with the
    quantiles for few demonstrations, and with those for many."""
    aligned_inside: tuple[float, float]
    """Share of the aligned demonstrations' samples inside the region of their phase."""


def measure(material: Material) -> Region:
    """Learn, and count the samples inside the 95 % region."""
    demonstrations = material.demonstrations
    skill = fit_skill(align(demonstrations.demonstrations))
    policy = skill.predict(_PHASES)
    angle = np.mean([d.poses[-1, 4] for d in demonstrations.demonstrations])
    angles = np.linspace(0.0, float(angle), _ARC_SAMPLES)
    known = sorted({radius for radius in demonstrations.radii if radius is not None})
    arcs = {radius: arc(radius, angles) for radius in known}
    own = skill.predict(skill.aligned.times)
    deviation = (skill.aligned.poses - own.mean)[:, :, PLANE] / own.std[:, PLANE]
    return Region(
        demonstrations=demonstrations,
        skill=skill,
        policy=policy,
        arcs=arcs,
        arc_inside=_inside(distance(policy, np.vstack(list(arcs.values()))), policy),
        aligned_inside=_inside((deviation**2).sum(axis=2), policy),
    )


def _inside(distances: FloatArray, policy: GaussianTrajectory) -> tuple[float, float]:
    """Shares of squared distances inside the wide and the narrow region."""
    wide, narrow = (
        float((distances <= squared_radius(free)).mean())
        for free in (policy.degrees_of_freedom, None)
    )
    return wide, narrow


def arc(radius: float, angles: FloatArray) -> FloatArray:
    """True path of a handle in the plane, (N, 2) [m]."""
    return handle_pose_on_arc(radius, angles)[:, PLANE]


def draw(shown: Region) -> Figure:
    """Draw both regions, mean, demonstrations and arcs at equal scales."""
    figure = style.new_figure(style.COLUMN, 2.85)
    axes = figure.subplots()
    normal = dataclasses.replace(shown.policy, degrees_of_freedom=None)
    for policy, name in ((shown.policy, "σ estimated"), (normal, "σ known")):
        shade_region(axes, policy, style.BEFORE)
        # The label is just inside the lower edge.
        reach = np.sqrt(squared_radius(policy.degrees_of_freedom)) * policy.std[:, Z]
        lowest = int(np.argmin(policy.mean[:, Z] - reach))
        axes.text(
            policy.mean[lowest, X],
            policy.mean[lowest, Z] - reach[lowest] + 0.015,
            f"95 %, {name}",
            horizontalalignment="center",
            fontsize=6.0,
            color=style.MARK,
        )
    for poses in shown.skill.aligned.poses:
        axes.plot(*poses[:, PLANE].T, color=style.DEMONSTRATION, linewidth=0.6)
    axes.lines[-1].set_label("demonstrations")
    colours = door_colours(shown.demonstrations.radii)
    for radius, path in shown.arcs.items():
        axes.plot(*path.T, color=colours[radius], label=f"arc, {radius:.2f} m")
    mean = shown.policy.mean[:, PLANE]
    axes.plot(*mean.T, color="black", linestyle=":", label="mean")
    axes.set(xlabel="$x$ [m], along the pull", ylabel="$z$ [m], across it", aspect=1)
    figure.legend(loc="outside upper center", ncols=3)
    return figure


def shade_region(axes: Axes, policy: GaussianTrajectory, colour: str) -> None:
    """Shade the union of the policy's 95 % regions over all phases."""
    limit = squared_radius(policy.degrees_of_freedom)
    mean, reach = policy.mean[:, PLANE], np.sqrt(limit) * policy.std[:, PLANE]
    low, high = (mean - reach).min(axis=0), (mean + reach).max(axis=0)
    margin = 0.02 * (high - low)
    x, z = np.linspace(low - margin, high + margin, _PIXELS).T
    # The root of the distance is nearly linear, so its contours are smooth.
    field = np.sqrt(distance(policy, np.stack(np.meshgrid(x, z), axis=-1)))
    edge = float(np.sqrt(limit))
    axes.contourf(x, z, field, levels=[0.0, edge], colors=[colour], alpha=0.2)
    axes.contour(x, z, field, levels=[edge], colors=[colour], linewidths=0.6)


def caption(shown: Region) -> str:
    """Describe the figure and state its numbers."""
    count = sum(map(len, shown.arcs.values()))
    wide, narrow = (round(share * count) for share in shown.arc_inside)
    aligned = [f"{100.0 * share:.1f} %" for share in shown.aligned_inside]
    return (
        "The policy learned from the demonstrations of Fig. 6 in the plane in which "
        "doors open (the closed handle at the origin, equal scales): mean (dotted), "
        "demonstrations, the true arcs of the doors, and the unions of the joint 95 % "
        "regions of x and z over all phases: the wide one with Hotelling's quantile "
        f"for {len(shown.skill.aligned.poses)} demonstrations, the narrow one with the "
        "normal quantile, for a known spread. The paper's Fig. 7 shows one region. Of "
        f"{count} samples of the arcs, {wide} are inside the wide region and {narrow} "
        f"inside the narrow one; of the aligned demonstrations, {aligned[0]} and "
        f"{aligned[1]} of the samples are inside at their own phase. Independent "
        "outputs give an ellipse parallel to the axes at each phase, although x and z "
        "are correlated over the doors."
    )
