"""Measures of one mission: errors, forces, ripple, the first mode, the inequalities of the theorems."""

from __future__ import annotations

import json

import numpy as np
import xarray as xr

from trussflow.blocks.support.types import Vector
from trussflow.models.geometry.rotation import euler_rate_matrix_inverse
from trussflow.models.reporting.metrics import (
    largest_component,
    late_part,
    tracking_metrics,
)

TORQUE_BOUNDS: dict[int | None, float] = {1: 0.25, 2: 0.8}
"""Bound on the control torques of each case in the paper, Figures 7 (Robot 4 only) and 14 [N·m]."""

LATE_FRACTION = 1 / 8
"""Late part of a run [-]; of 80 s the last 10 s."""

RIPPLE_WINDOW = 0.2  # s
"""Width of the centred mean that is subtracted; ripple is the rest, above about 2 Hz."""

SETTLING_MULTIPLE = 5.0
"""Time constants 1/L of the observer after which its initial error has decayed [-]."""


def measured(result: xr.Dataset) -> dict[str, float | Vector]:
    """Return the measures of a run by name [as in `report_numbers`].

    Errors, displacements and torques are largest components over time; forces of robots are largest
    Euclidean norms. The last three values are amplitudes late in the run, of each task coordinate and of
    the sliding variable.

    Parameters
    ----------
    result : xarray.Dataset
        Log of a transport diagram with four robots of seven joints and Euler angles.
    """
    time, window = result["time"].values, LATE_FRACTION * result["time"].values[-1]
    errors = {
        part: result[f"{part}_error"].values
        for part in ("position", "attitude", "joint")
    }
    metrics = tracking_metrics(
        time, {f"{part} error": error for part, error in errors.items()}, late=window
    )
    found = {
        name.removesuffix(" (component)"): value for name, value in metrics.items()
    }
    for name, values in {
        "sideways error": errors["position"][:, :2],
        "angle of C41": errors["joint"][:, 21],
        "rate of C41": result["joint_rate"].values[:, 21],
    }.items():
        found[f"peak {name}"] = largest_component(values)

    force = result["generalized_force"].values[:, :3]
    found["force ripple"] = ripple(time, force)
    found["modal ripple"] = ripple(time, result["modal_coordinate"].values)
    found["velocity ripple"] = ripple(time, result["position_error_rate"].values)
    found["largest jump of force per peak"] = largest_component(
        np.diff(force, axis=0)
    ) / largest_component(force)
    norms = np.linalg.norm(result["base_force"].values, axis=2)
    peaks = norms.max(axis=0)
    found["impulse of the base forces"] = norms.sum() * (time[1] - time[0])
    found["share of Robots 1, 2, 4"] = peaks[[0, 1, 3]].sum() / peaks.sum()
    bent = np.abs(result["grasp_displacement"].values).max(axis=(0, 2), initial=0.0)
    for i, (peak, displacement) in enumerate(zip(peaks, bent, strict=True), 1):
        found[f"peak base force, Robot {i}"] = peak
        found[f"share of Robot {i}"] = peak / peaks.sum()
        found[f"peak elastic displacement at grasp {i}"] = displacement
    for suffix, first in (("", 0), (" of Robot 4", 3)):
        base = result["base_torque"].values[:, first:].reshape(len(time), -1)
        joint = result["joint_torque"].values[:, 7 * first :]
        both = np.abs(np.hstack([base, joint])).max(axis=1)
        found[f"peak base torque{suffix}"] = largest_component(base)
        found[f"peak joint torque{suffix}"] = largest_component(joint)
        found[f"largest torque{suffix}"] = both.max()
        found[f"time of the largest torque{suffix}"] = time[both.argmax()]

    late = late_part(time, window)
    mode = result["modal_coordinate"].values[late, :1].ravel()  # none if rigid
    instants, maxima = envelope(time[late], mode)
    found["measured growth of mode 1"] = np.nan
    if len(maxima) > 1:
        growth = np.polyfit(instants, np.log(maxima), 1)[0]
        found["measured growth of mode 1"] = growth
    error = np.hstack(list(errors.values()))
    rate = np.hstack([result[f"{part}_error_rate"].values for part in errors])
    sliding = np.asarray(result.get("sliding_variable", np.full_like(error, np.nan)))
    theorems = theorem_measures(*observer_signals(result), *observer_gains(result))
    amplitudes = {
        "late error": np.abs(error[late]).max(axis=0),
        "late rate": np.abs(rate[late]).max(axis=0),
        "late sliding": np.linalg.norm(sliding[late], axis=1).mean(),
    }
    return found | theorems | amplitudes


def of_robot(result: xr.Dataset, robot: int) -> xr.Dataset:
    """Return the signals of a robot alone.

    Parameters
    ----------
    result : xarray.Dataset
        Result of a run.
    robot : int
        Number of the robot, from 1 [-].
    """
    joints = [
        name for name in result["joint"].values if name.startswith(f"theta_{robot}_")
    ]
    return result.sel(robot=robot, joint=joints)


def ripple(time: Vector, values: Vector) -> float:
    """Return the root mean square of the deviation of a vector from its moving mean, over all axes.

    Parameters
    ----------
    time : array, shape (n,)
        Evenly spaced instants [s].
    values : array, shape (n, m)
        Vector at each instant [any].
    """
    half = round(RIPPLE_WINDOW / (time[1] - time[0]) / 2)
    # With differences of cumulative sums the cost does not depend on the width of the window.
    sums = np.cumsum(np.pad(values, ((1, 0), (0, 0))), axis=0)
    mean = (sums[2 * half + 1 :] - sums[: -2 * half - 1]) / (2 * half + 1)
    return float(np.sqrt(np.mean(np.sum((values[half:-half] - mean) ** 2, axis=1))))


def envelope(time: Vector, values: Vector) -> tuple[Vector, Vector]:
    """Return times and values of the local maxima of the absolute value.

    Parameters
    ----------
    time : array, shape (n,)
        Instants [s].
    values : array, shape (n,)
        Oscillating signal [any].
    """
    size = np.abs(values)
    inner = np.flatnonzero((size[1:-1] >= size[:-2]) & (size[1:-1] > size[2:])) + 1
    return time[inner], size[inner]


def observer_signals(result: xr.Dataset) -> tuple[Vector, Vector, Vector, Vector]:
    r"""Return the time [s], :math:`\|\hat d - d\|`, V and :math:`\|\dot d\|` of a run.

    The norms are over all 34 coordinates, with m and rad mixed, as in the paper. The rates of the
    disturbance are difference quotients, so at most the largest rates between the logged instants.

    Parameters
    ----------
    result : xarray.Dataset
        Log of a transport diagram; without sliding variable, V is that of the estimate alone.
    """
    time, d = result["time"].values, result["disturbance"].values
    error = np.linalg.norm(result["disturbance_estimate"].values - d, axis=1)
    sliding = np.linalg.norm(result.get("sliding_variable", 0.0 * d), axis=1)
    rates = np.linalg.norm(np.diff(d, axis=0) / np.diff(time)[:, None], axis=1)
    return time, error, (sliding**2 + error**2) / 2, rates


def observer_gains(result: xr.Dataset) -> tuple[float, float, float]:
    """Return L [1/s] and sigma [1/s], NaN if the law has none, and the largest norm of J_g [-].

    Parameters
    ----------
    result : xarray.Dataset
        Log of a transport diagram.
    """
    used = json.loads(result.attrs["parameters"])
    # J_g varies slowly with the attitude; its other blocks, R_t and I, have norm one.
    attitudes = result["attitude"].values[::10]
    norms = [
        np.linalg.norm(euler_rate_matrix_inverse(angles), 2) for angles in attitudes
    ]
    names = ("observer.gain", "controller.sigma")  # equal for all coordinates
    L, sigma = (float(np.ravel(used.get(name, np.nan))[0]) for name in names)
    return L, sigma, max(1.0, *map(float, norms))


def theorem_measures(
    time: Vector,
    error: Vector,
    lyapunov: Vector,
    rates: Vector,
    L: float,
    sigma: float,
    jacobian: float,
) -> dict[str, float]:
    r"""Return the terms of Theorems 1 and 2 of the paper along a trajectory.

    Theorem 1: :math:`\|\hat d - d\| \le \xi / L` ultimately, for :math:`\|\dot d\| \le \xi`.
    By Eq. 51, :math:`V_1 = \|\hat d - d\|^2 / 2` is at most
    :math:`V_1(0) e^{-Lt} + (1 - e^{-Lt}) \xi^2 / 2 L^2`.

    Theorem 2: for :math:`\sigma > \bar J^2 / L` and
    :math:`V = (\|s\|^2 + \|\hat d - d\|^2) / 2`,
    :math:`\dot V \le -\rho V + \xi^2 / 2 L` with :math:`\rho = \min(\sigma, L - \bar J^2/\sigma)`,
    so that V decreases wherever it is above :math:`\xi^2 / 2 \rho L`; by Eq. 61 it is at most
    :math:`V(0) e^{-\rho t} + (1 - e^{-\rho t}) \xi^2 / 2 \rho L`.

    Parameters
    ----------
    time : array, shape (n,)
        Instants [s].
    error, lyapunov : array, shape (n,)
        Norm of the estimation error [m/s² and rad/s²], and V.
    rates : array, shape (n - 1,)
        Norm of the rate of the disturbance between instants [m/s³ and rad/s³].
    L, sigma, jacobian : float
        L [1/s], sigma [1/s], largest norm of J_g [-].
    """
    xi = rates.max()
    settled = (
        error[time > min(SETTLING_MULTIPLE / L, time[-1] / 2)].max()
        if L == L
        else np.nan
    )
    rho = min(sigma, L - jacobian**2 / sigma)
    bound = xi**2 / (2 * rho * L) if rho > 0 else np.inf
    slope = np.diff(lyapunov) / np.diff(time)
    middle = (lyapunov[1:] + lyapunov[:-1]) / 2
    disturbing = rates**2 / (2 * L)  # largest contribution of the disturbance to dV/dt
    must_fall = rho * middle > disturbing
    with np.errstate(divide="ignore", invalid="ignore"):
        # a rigid truss has no disturbance
        part = ((slope + rho * middle) / disturbing).max()
    return {
        "L": L,
        "xi": xi,
        "bound of Theorem 1": xi / L,
        "settled estimation error": settled,
        "slack of Theorem 1": xi / L / settled,
        "largest part of the bound of Eq. 51": _largest_part(
            time, error**2 / 2, L, xi**2 / (2 * L**2)
        ),
        "norm of J_g": jacobian,
        "least sigma": jacobian**2 / L,
        "sigma": sigma,
        "slack of sigma": sigma / (jacobian**2 / L),
        "rho": rho,
        "ultimate bound of V": bound,
        "largest part of the bound of Eq. 61": _largest_part(time, lyapunov, rho, bound)
        if rho > 0
        else np.nan,
        "largest V": lyapunov.max(),
        "time of V above its bound": np.mean(lyapunov > bound),
        "time in which V must fall": np.mean(must_fall),
        "instants at which V rises though it must fall": np.count_nonzero(
            slope[must_fall] >= 0
        ),
        "largest part of the bound on the slope": part,
    }


def _largest_part(time: Vector, values: Vector, rate: float, last: float) -> float:
    """Return the largest ratio of values to a bound that goes from the first one to the last."""
    decay = np.exp(-rate * (time[1:] - time[0]))
    bound = decay * values[0] + (1.0 - decay) * last
    return float((values[1:] / bound).max())
