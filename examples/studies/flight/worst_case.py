r"""Worst case of the loop: a search by simulations, and a stability condition on a grid of frequencies.

The condition is about the impedance Z(s) of plant and sampled controller, from velocities to forces, without
aliases: a member with a pole at s has a singular Z(s). Mass, squared frequency, damping and payload enter Z
almost linearly, one by one. So each Z in a box of them is in the convex hull of those at the corners,
:math:`Z_i`. All matrices of the hull are regular if for some W and a positive diagonal matrix D

.. math:: X_i + X_i^* > 0 \quad \text{for all } i, \qquad X_i = D^{-1} W Z_i D, \qquad
          W = (\bar Z + \kappa I)^{-1}

with the mean :math:`\bar Z` of the corners: :math:`\kappa = 0` suits small changes of Z, and a large one passive
loops. Poles are continuous in the parameters. If the poles of the corners are to the left of
a vertical line, and no Z is singular on it, no member has a pole to the right of the line.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy
import xarray as xr

from flight.campaigns import LOOPS, WORST_CASE, Campaign
from flight.margins import INSTANTS, loop_session, loops_along
from flight.sampled_loop import SampledLoop
from flight.samples import (
    MAX_DAMPING,
    MAX_DEVIATION,
    MAX_PAYLOAD,
    MIN_DAMPING,
    NOMINAL_SEED,
    noise_parameters,
    truss_parameters,
    varied_truss,
)
from trussflow.blocks.support.types import Array, Vector
from trussflow.models.hardware.hardware import Hardware
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.transport.mission import Mission
from trussflow.models.truss.truss_modes import TrussModes

SEARCHED = ("position", "attitude")
"""Metrics that are maximized."""

POPULATION_SIZE = 16
"""Number of runs in one generation of the search [-]."""

SPREADS = (1.0, 0.7, 0.5)
"""Standard deviation of each generation about the best point before it, relative to half a range [-]."""

PARAMETER_COUNT = 4
"""Number of parameters in the proof: mass, frequency, damping and payload [-]."""

SHAPE_COUNT = 6
"""Number of modes, the slowest, whose shapes at the grasps vary in the search [-]."""

BIASES = PARAMETER_COUNT + SHAPE_COUNT
"""Place of the encoder biases in a point of the search [-]."""

DIMENSION = BIASES + 4
"""Dimension of the box of the search, with one bias for each robot [-]."""

MAX_SHAPE = 2.0 * MAX_DEVIATION
"""Largest relative deviation of a mode shape at the grasps: two of the largest standard deviations [-]."""

MAX_BIAS = 1e-3
"""Largest bias of the encoders, equal in the joints of each robot [rad]."""

INSTANT = "peak acceleration"
"""Instant of the linearization, in `INSTANTS`."""

MAX_FREQUENCY = 1000.0
"""Largest frequency of the proof, above those of all modes [rad/s]."""

FREQUENCIES = np.append(0.0, np.geomspace(0.01, MAX_FREQUENCY, 400))
"""Frequencies of the proof [rad/s]."""

PROVED_DECAY = 0.02
"""Decay rate of all members that is to be proved [1/s]."""

SHIFTS = (0.0, *10.0 ** np.arange(-1.0, 4.6, 0.5))
"""Values of κ, in coordinates with unit mass [1/s]."""

MAX_BOXES = 500
"""Largest number of boxes of parameters at one frequency [-]."""

NEWTON_STEPS, DIFFERENCE_STEP = 6, 1e-6
"""Number of steps of Newton's method, and relative step of its differences [-]."""

MIDDLE = np.array([0.0, 1.0, -1.0, 0.0])
"""Point with mean mass and payload, the largest frequencies and the least damping."""


class Proof(NamedTuple):
    """Result of the linear analysis.

    Attributes
    ----------
    growth : float
        Largest growth rate of a corner of the box [1/s].
    bound : float
        Upper bound on the growth rate of all members, NaN if none is proved [1/s].
    middle, interpolated : float
        Growth rate at `MIDDLE`, exact and by the interpolated impedance [1/s].
    """

    growth: float
    bound: float
    middle: float
    interpolated: float


class Member(NamedTuple):
    """Linear loop with one truss.

    Attributes
    ----------
    loop : SampledLoop
        Plant and controller.
    mass : Vector, shape (n, n)
        Mass matrix of the plant [kg, kg·m, kg·m²].
    basis : Vector, shape (n, n)
        Velocities of the plant by common coordinates of all members [any].
    """

    loop: SampledLoop
    mass: Vector
    basis: Vector

    def impedance(self, s: complex) -> Array:
        """Return the impedance of plant and controller without aliases, from common velocities to forces.

        Parameters
        ----------
        s : complex
            Laplace variable, not zero [1/s].
        """
        p, k, n = self.loop.plant, self.loop.controller, len(self.mass)
        delay = np.exp(-s * k.dt)
        held = (1.0 - delay) / (s * k.dt) * k(1.0 / delay)
        A = p.A + p.B @ held @ p.C
        positions = np.linalg.solve(s * np.eye(n) - A[:n, :n], A[:n, n:])
        forces = self.mass @ (s * np.eye(n) - A[n:, n:] - A[n:, :n] @ positions)
        return np.asarray(self.basis.T @ forces @ self.basis)

    def slowest(self) -> complex:
        """Return the exact pole of the sampled loop that decays most slowly [1/s]."""
        poles = np.linalg.eigvals(self.loop.closed())
        slowest = poles[np.abs(poles).argmax()]
        return complex(np.log(complex(slowest)) / self.loop.controller.dt)


def ascended(errors: Callable[[Vector], Vector], count: int) -> Vector:
    """Return the point with the greatest error found in a box from -1 to 1.

    Each generation is normally distributed about the best point so far, and clipped to the box.

    Parameters
    ----------
    errors : callable
        Function of the points of a generation, by rows; NaN counts as infinite.
    count : int
        Dimension of the box [-].
    """
    random = np.random.default_rng(0)
    best, greatest = np.zeros(count), -np.inf
    for spread in SPREADS:
        steps = spread * random.standard_normal((POPULATION_SIZE, count))
        points = np.clip(best + steps, -1.0, 1.0)
        values = np.nan_to_num(errors(points), nan=np.inf)
        if values.max() > greatest:
            best, greatest = points[values.argmax()], values.max()
    return best


def truss_of(point: Vector, modes: int) -> dict[str, Any]:
    """Return the arguments of `varied_truss` at a point of the box.

    Parameters
    ----------
    point : Vector
        Mass, frequency, logarithm of damping, payload, and any number of shapes, from -1 to 1 [1].
    modes : int
        Number of modes [-].
    """
    middle = np.sqrt(MIN_DAMPING * MAX_DAMPING)
    shapes = np.zeros(modes)
    shapes[: len(point) - PARAMETER_COUNT] = MAX_SHAPE * point[PARAMETER_COUNT:]
    return {
        "mass": MAX_DEVIATION * point[0],
        "frequency": MAX_DEVIATION * point[1],
        "damping": middle * (MAX_DAMPING / middle) ** point[2],
        "payload": MAX_PAYLOAD * (1.0 + point[3]) / 2.0,
        "shapes": shapes,
    }


def varied_parameters(
    plant: TunableTruss, point: Vector
) -> tuple[TrussModes, dict[str, Any]]:
    """Return truss and parameters of a run at a point of the box; the plant must be named ``truss``."""
    nominal = plant.dynamics.modes
    truss = varied_truss(nominal, **truss_of(point, nominal.modes))
    return truss, truss_parameters(plant, truss)


def generation(name: str, points: Vector) -> Campaign:
    """Return the runs with the trusses and encoder biases of some points, with the noise of one seed."""
    loop = next(iter(LOOPS))
    plant = TunableTruss.accurate(arm=LOOPS[loop]["arm"])
    each, rows = plant.joints // plant.robots, []
    for point in points:
        own, biases = np.split(point, [BIASES])
        bias = np.repeat(MAX_BIAS * biases, each)
        rows.append(
            varied_parameters(plant, own)[1]
            | noise_parameters(NOMINAL_SEED)
            | {
                "faults.end": 1e9,
                "faults.bias": np.append(np.zeros(plant.rigid - plant.joints), bias),
            }
        )
    return Campaign(
        section=WORST_CASE,
        name=f"{loop}, {name}",
        options=LOOPS[loop],
        rows=rows,
        labels=range(len(rows)),
    )


def searched(metric: str, runs: Path | None = None, **options: Any) -> dict[str, Any]:
    """Return metrics, truss and encoder biases of the worst run found.

    Parameters
    ----------
    metric : str
        Maximized metric.
    runs : pathlib.Path, optional
        Folder for finished runs; the same call resumes.
    **options
        Further arguments of `Campaign.run`.
    """
    results = list[xr.Dataset]()

    def errors(points: Vector) -> Vector:
        # Both searches have the same first generation.
        name = f"worst {metric if results else 'case'}, generation {len(results) + 1}"
        results.append(generation(name, points).run(runs, **options))
        return np.asarray(results[-1][metric].values)

    best = ascended(errors, DIMENSION)
    found = xr.concat([one[list(SEARCHED)] for one in results], "sample")
    worst = found.isel(sample=int(np.argmax(found[metric].fillna(np.inf).values)))
    return {
        **{name: float(worst[name]) for name in SEARCHED},
        **truss_of(best[:BIASES], TunableTruss.accurate().modes),
        "biases": MAX_BIAS * best[BIASES:],
    }


def family() -> Callable[[Vector], Member]:
    """Return the function of a point of the box that returns its loop at peak acceleration in Case 1."""
    session, plant = loop_session(), TunableTruss.accurate()
    dynamics = Hardware.flight().mounted(plant).dynamics
    shapes = plant.dynamics.modes.shapes.reshape(-1, plant.modes)
    duration, instant = Mission.of_case(1).duration, {INSTANT: INSTANTS[INSTANT]}

    def member(point: Vector) -> Member:
        truss, values = varied_parameters(plant, point)
        ((_, loop),) = loops_along(session, duration, values, instant)
        q, v = np.split(session.save().x, [dynamics.coordinates])
        # The modes of a loaded truss change their order and sign. Coordinates of the nominal modes do not.
        mix = np.linalg.lstsq(shapes, truss.shapes.reshape(-1, truss.modes))[0]
        basis = np.eye(dynamics.freedoms)
        basis[-plant.modes :, -plant.modes :] = np.linalg.inv(mix)
        mass = dynamics.evaluate(q, v, truss.data).mass_matrix
        return Member(loop, mass, basis)

    return member


def proved(
    corners: Callable[[complex], Array], decay: float, omega: Vector = FREQUENCIES
) -> bool:
    """Return whether no member has a pole with this decay rate at these frequencies; False if unknown.

    Parameters
    ----------
    corners : callable
        Function of the Laplace variable that returns the impedances of all corners, shape (2, ..., 2, n, n).
    decay : float
        Decay rate [1/s].
    omega : Vector
        Frequencies [rad/s].
    """
    return all(box_is_regular(corners(complex(-decay, w))) for w in omega)


def box_is_regular(corners: Array) -> bool:
    """Return whether all matrices of a box of parameters are regular; False if unknown.

    The matrices are linear in each parameter. Boxes without a multiplier are halved, one parameter after another.

    Parameters
    ----------
    corners : array, shape (2, ..., 2, n, n)
        Matrices at the ends of each parameter.
    """
    left = [(corners, 0)]
    for _ in range(MAX_BOXES):
        if not left:
            return True
        box, axis = left.pop()
        if has_multiplier(box.reshape(-1, *corners.shape[-2:])):
            continue
        middle = box.mean(axis=axis, keepdims=True)
        for end in (0, 1):
            half = np.concatenate([np.take(box, [end], axis), middle], axis)
            left.append((half, (axis + 1) % (corners.ndim - 2)))
    return not left


def has_multiplier(matrices: Array) -> bool:
    """Return whether one of the multipliers proves that the convex hull of some matrices is regular.

    Parameters
    ----------
    matrices : array, shape (k, n, n)
    """
    middle = matrices.mean(axis=0)
    for shift in SHIFTS:
        try:
            found = np.linalg.solve(middle + shift * np.eye(len(middle)), matrices)
        except np.linalg.LinAlgError:
            continue
        spread = np.abs(found - found.mean(axis=0)).max(axis=0)
        _, (scale, _) = scipy.linalg.matrix_balance(
            spread, permute=False, separate=True
        )
        for each in (found * scale / scale[:, None], found):
            # The factorization fails unless all matrices are positive definite.
            with contextlib.suppress(np.linalg.LinAlgError):
                np.linalg.cholesky(each + each.conj().swapaxes(-1, -2))
                return True
    return False


def proof() -> Proof:
    """Return growth rates of the corners and the member at `MIDDLE`, and a bound for all members."""
    member = family()
    middle = member(MIDDLE)
    mass = middle.basis.T @ middle.mass @ middle.basis
    unit = np.linalg.inv(np.linalg.cholesky(mass))
    corners = [
        member(np.array(ends)) for ends in product(*[(-1.0, 1.0)] * PARAMETER_COUNT)
    ]

    def impedances(s: complex) -> Array:
        found = np.array([unit @ each.impedance(s) @ unit.T for each in corners])
        return found.reshape(*(2,) * PARAMETER_COUNT, *unit.shape)

    growth = max(each.slowest().real for each in corners)
    known = growth < -PROVED_DECAY and proved(impedances, PROVED_DECAY)
    pole = middle.slowest()
    near = pole_near(lambda s: impedances(s)[:, 1, 0].mean(axis=(0, 1)), pole)
    return Proof(
        growth, -PROVED_DECAY if known else np.nan, pole.real, float(near.real)
    )


def pole_near(impedance: Callable[[complex], Array], pole: complex) -> complex:
    """Return a point near a pole where an impedance is singular, by Newton's method for its determinant."""
    for _ in range(NEWTON_STEPS):
        step = DIFFERENCE_STEP * abs(pole)
        change = impedance(pole + step) - impedance(pole - step)
        pole -= 2.0 * step / np.trace(np.linalg.solve(impedance(pole), change))
    return pole
