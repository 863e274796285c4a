"""Write movement_primitives.npz: what another library computes, for the tests here.

The library is movement_primitives 0.9.1 (Fabisch, *movement_primitives: Imitation
Learning of Cartesian Motion with Movement Primitives*, JOSS 9(97), 2024). It needs a
compiler to install, so the tests read its results instead of importing it. To write
them again, from the root of the repository:

    pip install movement_primitives==0.9.1
    python tests/policies/data/make_movement_primitives.py

Nothing of `policies` takes part except the alignment of the demonstrations. Inputs are
stored beside the results. Demonstrations and deviations are rounded to few binary
digits: that makes them small, and sums of them and of their products exact, hence equal
on every machine. Phases [-], positions [m], rotation vectors [rad]:

    phases, poses            six demonstrations, (101,) and (6, 101, 6)
    dmp_alpha, dmp_alpha_x, dmp_overlap    constants of the library's DMP of positions
    dmp_weights              what it learned from their mean, (3, 30)
    dmp_steps                step sizes of three rollouts with these weights, (3,)
    dmp_times, dmp_rollouts  51 samples of each, (3, 51) and (3, 51, 3)
    dmp_reproduction         rollout of step 0.005 at `phases`, (101, 3)
    promp_learned            mean of the six weight vectors by regression, as positions
                             at every second phase, (51, 6)
    promp_em_mean, promp_em_variance       the same phases, learned by EM, (51, 6)
    promp_mean, promp_deviations           a distribution of weights, (120,), (6, 120):
                             mean, and A in Σ = S + diag(S) / 2 with S = AᵀA
    promp_phases, promp_positions, promp_rates    its mean, (31,) and twice (31, 6)
    promp_covariance         every output's lower triangle at each second one of these
                             phases, (6, 136)
    via_phases, via_poses, via_stds        two via-points, (2,), (2, 6), (2,)
    conditioned_mean         the mean of the weights given both, (120,)
    conditioned_covariance   one column of their covariance per output, (120, 6)
    conditioned_columns      which columns, (6,)
"""

import runpy
from importlib.metadata import version
from pathlib import Path

import numpy as np
from movement_primitives.dmp import DMP
from movement_primitives.promp import ProMP

from gplfd_policies import align

LIBRARY_VERSION = "0.9.1"
FOLDER = Path(__file__).parent
Arrays = dict[str, np.ndarray]


def rounded(values: np.ndarray, digits: int) -> np.ndarray:
    """The nearest multiples of 2^-digits."""
    return np.round(values * 2.0**digits) / 2.0**digits


def demonstrations() -> Arrays:
    """Those of the other tests, on 101 phases."""
    made = runpy.run_path(str(FOLDER.parent / "conftest.py"))["door_demonstrations"]()
    aligned = align(made, n_samples=101)
    return {"phases": np.array(aligned.times), "poses": rounded(aligned.poses, 20)}


def imitated(phases: np.ndarray, path: np.ndarray, step: float) -> DMP:
    """A dynamic movement primitive of positions, learned from ``path``."""
    dmp = DMP(
        n_dims=3,
        dt=step,
        n_weights_per_dim=30,
        smooth_scaling=True,
        alpha_y=25.0,
        beta_y=6.25,
    )
    dmp.imitate(phases.copy(), path)
    return dmp


def dynamic(phases: np.ndarray, poses: np.ndarray) -> Arrays:
    """Learning and rollouts of dynamic movement primitives."""
    path = poses.mean(axis=0)[:, :3]
    steps = np.array([2e-3, 1e-3, 5e-4])
    times, rollouts = [], []
    for step in steps:
        dmp = imitated(phases, path, step)
        each = round(0.02 / step)
        clock, positions = dmp.open_loop()
        times.append(clock[::each])
        rollouts.append(positions[::each])
    clock, reproduction = imitated(phases, path, 0.005).open_loop()
    np.testing.assert_allclose(clock[::2], phases, atol=1e-12)
    return {
        "dmp_alpha": np.float64(25.0),
        "dmp_alpha_x": np.float64(dmp.forcing_term.alpha_z),
        "dmp_overlap": np.float64(dmp.forcing_term.overlap),
        "dmp_weights": dmp.forcing_term.weights_,
        "dmp_steps": steps,
        "dmp_times": np.array(times),
        "dmp_rollouts": np.array(rollouts),
        "dmp_reproduction": reproduction[::2],
    }


def probabilistic(phases: np.ndarray, poses: np.ndarray) -> Arrays:
    """Learning and conditioning of probabilistic movement primitives."""
    learner = ProMP(n_dims=6, n_weights_per_dim=20)
    # The library divides times in place by their maximum: it gets copies.
    weights = np.array([learner.weights(phases.copy(), demo) for demo in poses])
    learned = learner.trajectory_from_weights(phases[::2].copy(), weights.mean(axis=0))
    learner.imitate(np.stack([phases] * 6), poses.copy())
    mean = rounded(weights.mean(axis=0), 20)
    deviations = rounded((weights - mean) / np.sqrt(5.0), 16)
    return {
        "promp_learned": learned,
        "promp_em_mean": learner.mean_trajectory(phases[::2].copy()),
        "promp_em_variance": learner.var_trajectory(phases[::2].copy()),
        "promp_mean": mean,
        "promp_deviations": deviations,
        **distribution(mean, deviations),
    }


def distribution(mean: np.ndarray, deviations: np.ndarray) -> Arrays:
    """What the library says of a distribution of weights, and of it given poses."""
    sample = deviations.T @ deviations
    np.testing.assert_array_equal(sample, deviations[::-1].T @ deviations[::-1])
    covariance = sample + 0.5 * np.diag(np.diag(sample))
    promp = ProMP(n_dims=6, n_weights_per_dim=20)
    promp.from_weight_distribution(mean, covariance)
    phases = np.linspace(0.0, 1.0, 31)
    joint = promp.cov_trajectory(phases[::2].copy()).reshape(6, 16, 6, 16)
    via_phases, via_stds = np.array([0.3, 0.7]), np.array([2e-3, 1e-2])
    pose = np.array([0.25, 0.0, -0.06, 0.0, 0.4, 0.0])
    via_poses = np.stack([pose + 0.01, pose + 0.05])
    given = promp
    for at, to, std in zip(via_phases, via_poses, via_stds, strict=True):
        given = given.condition_position(to, y_cov=std**2 * np.eye(6), t=at)
    columns = np.array([7, 31, 44, 60, 99, 112])
    lower = np.tril_indices(16)
    return {
        "promp_phases": phases,
        "promp_positions": promp.mean_trajectory(phases.copy()),
        "promp_rates": promp.mean_velocities(phases.copy()),
        "promp_covariance": np.array([joint[d, :, d][lower] for d in range(6)]),
        "via_phases": via_phases,
        "via_poses": via_poses,
        "via_stds": via_stds,
        "conditioned_mean": given.weight_mean,
        "conditioned_columns": columns,
        "conditioned_covariance": given.weight_cov[:, columns],
    }


def main() -> None:
    found = version("movement_primitives")
    if found != LIBRARY_VERSION:
        raise SystemExit(f"Needs movement_primitives {LIBRARY_VERSION}, got {found}.")
    inputs = demonstrations()
    arrays = inputs | dynamic(**inputs) | probabilistic(**inputs)
    target = FOLDER / "movement_primitives.npz"
    np.savez_compressed(target, **arrays)
    print(f"{target.name}: {len(arrays)} arrays, {target.stat().st_size} bytes")


if __name__ == "__main__":
    main()
