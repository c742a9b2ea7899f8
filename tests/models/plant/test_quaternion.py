"""The plant with a quaternion: the same motion as with Euler angles, and any other motion too."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation
from scipy.special import ellipj

from trussflow.blocks import Diagram, Simulator
from trussflow.models import EULER, QUATERNION, SpaceTruss

SOLVED = 1e-9  # what the solvers' tolerance of 1e-11 leaves after some seconds
ANGLES = (0.4, -0.3, 0.9)  # rad, far from the singularity


def flown(truss, speeds, duration, **initial):
    """Return the free motion of a truss."""
    diagram = Diagram("free truss")
    diagram.add(truss=truss)
    diagram.ground(truss.actuation)
    log = [truss.coordinates, truss.speeds, truss.energy]
    simulator = Simulator(diagram, solver="DOP853", rtol=1e-11, atol=1e-12, log=log, log_step=duration / 40)
    start = {"truss.v": speeds, **{f"truss.{name}": value for name, value in initial.items()}}
    return simulator.run(duration, initial=start, progress=False)


@pytest.fixture
def modules(random_system):
    """Return a flexible truss that holds two bases by its own, without symmetry, in some attitude."""
    dynamics = random_system(("", "R"), 2, elastic_integrals=True)
    return SpaceTruss(dynamics).turned(np.array(ANGLES))


def test_the_same_motion_as_with_euler_angles(modules, rng):
    speeds = 0.3 * rng.standard_normal(modules.n)
    euler, ours = (flown(truss, speeds, 2.0) for truss in (modules, modules.with_quaternion()))
    angles, numbers = (run["truss.coordinates"].values for run in (euler, ours))
    assert np.ptp(angles[:, 3]) > 0.1
    assert np.abs(ours["truss.speeds"].values - euler["truss.speeds"].values).max() < SOLVED
    assert np.abs(np.delete(numbers, np.s_[3:7], 1) - np.delete(angles, np.s_[3:6], 1)).max() < SOLVED
    for one, other in zip(angles, numbers, strict=True):
        assert np.abs(EULER.rotation(one[3:6]) - QUATERNION.rotation(other[3:7])).max() < SOLVED


def test_a_tumble_through_the_singularity_conserves_all(modules):
    """Three turns about body x, which pass φ = 90° six times, with the modes and a joint in motion."""
    truss = modules.with_quaternion()
    speeds = np.r_[0.1, 0.2, -0.1, 2.0, 0.1, 0.05, np.full(truss.n - 6, 0.05)]
    run = flown(truss, speeds, 10.0)
    q, v, energy = (run[f"truss.{name}"].values for name in ("coordinates", "speeds", "energy"))
    upright = [QUATERNION.rotation(each[3:7])[2, 1] for each in q]  # sin φ
    assert max(upright) > 0.9
    assert min(upright) < -0.9
    assert np.abs(energy / energy[0] - 1.0).max() < SOLVED
    momentum = np.array([np.concatenate(truss.dynamics.momentum(*each)) for each in zip(q, v, strict=True)])
    assert np.abs(momentum - momentum[0]).max() < SOLVED * np.abs(momentum).max()
    assert np.abs(np.linalg.norm(q[:, 3:7], axis=1) - 1.0).max() < SOLVED


def test_a_rigid_tumble_is_euler_s_and_jacobi_s(random_system):
    """A rigid body without symmetry: angular velocity by elliptic functions, attitude by quadrature.

    In principal axes, with the momentum along inertial z, the 3-1-3 angles of a free body are known: the
    components of the momentum give two, and the rate of the third depends on them only.
    """
    truss = SpaceTruss(random_system((), 0, elastic_integrals=True)).with_quaternion()
    mass = truss.dynamics.mass_matrix(truss.dynamics.rest)
    centre = np.array([mass[1, 5], -mass[0, 5], mass[0, 4]]) / mass[0, 0]
    moment = mass[0, 0] * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    inertia, axes = np.linalg.eigh(mass[3:, 3:] - moment)
    inertia, axes = inertia[::-1], axes[:, ::-1]
    axes[:, 2] *= np.linalg.det(axes)  # right-handed, I1 > I2 > I3
    i1, i2, i3 = inertia
    # Landau, Lifshitz, Mechanics, section 37, which has I3 > I2 > I1 and L² > 2 E I2.
    w1, w3 = 0.3, 0.1
    energy2, square = i1 * w1**2 + i3 * w3**2, (i1 * w1) ** 2 + (i3 * w3) ** 2
    assert square > energy2 * i2
    pace = np.sqrt((i1 - i2) * (square - energy2 * i3) / (i1 * i2 * i3))
    modulus = (i2 - i3) * (energy2 * i1 - square) / ((i1 - i2) * (square - energy2 * i3))
    top2 = np.sqrt((energy2 * i1 - square) / (i2 * (i1 - i2)))

    def rates(t):
        sn, cn, dn, _ = ellipj(pace * t, modulus)
        # The book's axes 3, 2, 1: to number them anew turns the sign of one.
        return np.array([w1 * dn, -top2 * sn, w3 * cn])

    size = np.sqrt(square)

    def turned(t):
        """Return the attitude of the principal axes in axes whose z is the momentum's."""
        m = inertia * rates(t) / size
        about, _ = quad(lambda s: _precession(inertia, rates(s), size), 0.0, t, epsabs=1e-12, epsrel=1e-12)
        angles = [about, np.arccos(m[2]), np.arctan2(m[0], m[1])]
        return Rotation.from_euler("ZXZ", angles)

    duration = 40.0
    start = np.concatenate([np.cross(axes @ rates(0.0), -centre), axes @ rates(0.0)])
    run = flown(truss, start, duration)
    q, v = run["truss.coordinates"].values, run["truss.speeds"].values
    first, principal = turned(0.0), Rotation.from_matrix(axes)
    for t, numbers, speeds in zip(run["time"].values, q, v, strict=True):
        assert np.abs(speeds[3:] - axes @ rates(t)).max() < SOLVED
        # Both start at one, so what lies between the inertial axes and those of the momentum drops out.
        expected = principal * first.inv() * turned(t) * principal.inv()
        assert np.abs(QUATERNION.rotation(numbers[3:]) - expected.as_matrix()).max() < 10 * SOLVED
        assert np.abs(numbers[:3] + QUATERNION.rotation(numbers[3:]) @ centre - centre).max() < 10 * SOLVED


def _precession(inertia, rates, size):
    """Return the rate of the first 3-1-3 angle [rad/s]."""
    i1, i2, _ = inertia
    w1, w2, _ = rates
    found = size * (i1 * w1**2 + i2 * w2**2) / ((i1 * w1) ** 2 + (i2 * w2) ** 2)
    return float(found)


def test_the_length_comes_back(modules):
    """A start that is off by a tenth is one again after a while, and turns nothing meanwhile."""
    truss = modules.with_quaternion()
    q, speeds = truss.parameters["initial_coordinates"], np.zeros(truss.n)
    run = flown(truss, speeds, 12.0, q=np.concatenate([q[:3], 0.9 * q[3:7], q[7:]]))
    numbers = run["truss.coordinates"].values[-1]
    assert np.abs(numbers - q).max() < SOLVED
