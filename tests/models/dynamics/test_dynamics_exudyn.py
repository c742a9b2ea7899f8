"""The flexible equations against a second code, Exudyn, by its stored accelerations and motion.

Exudyn knows the truss as a floating frame with modes of its nodal mass and stiffness matrix,
and each robot as nine bodies with absolute coordinates and constraints between them. What it
computed lies in tests/models/exudyn, beside the scripts that made it.

The two codes differ in one convention. Exudyn turns a hand by the exponential of the elastic
rotation vector c, this package by Cayley's formula; both are I + c× + O(c²), and accelerations
differ by the order of c². With the exponential in Cayley's place the equations are the same.

Exudyn 1.13 also makes a mistake: where a marker holds a hand, it takes the components of the
hand's angular velocity in the turned axes for components in the truss frame, which is wrong by
c × c'. It does not show where c = 0, and where a hand turns about one axis only. So one set of
modes, "one_axis", is made such that each held frame of the truss turns about one axis; the
other, "any_axis", are the truss's own modes.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trussflow.blocks import Constant, Diagram, Simulator
from trussflow.blocks.framework.types import Vector
from trussflow.models import RobotArm, SpaceTruss, TrussDynamics, TrussModes
from trussflow.models.geometry.rotation import cross_matrix, euler_rotation
from trussflow.models.robots import hand_motion
from trussflow.models.truss.truss_terms import truss_terms

FOLDER = Path(__file__).parent / "exudyn"

# Of the largest acceleration of a kind. For the acceleration of its joints Exudyn differentiates
# their Jacobians numerically; `test_tolerances_are_as_large_as_exudyns_noise` has its noise.
TOLERANCE = {"velocity": 3e-9, "spin": 3e-9, "joints": 3e-8, "modes": 3e-9}
# Of M a + b - f against f - b, each row in its own scale: the light links' rows have the noise
# of the joints' accelerations.
RESIDUAL = 5e-8
# The truss alone has no joint, and nothing is differentiated: round-off of a matrix whose
# condition number is 1e4.
ALONE = 1e-11

# How much Exudyn's extrapolated motion changes with the last halving of its step: position [m],
# attitude, joint angles [rad], modal coordinates [kg^½·m], speeds [m/s, rad/s]. Its joint rates
# are left out: on joints imposed on positions the trapezoidal rule lets them ring.
MOTION = {"positions": 3e-9, "attitudes": 3e-9, "joint_angles": 3e-5, "modal": 3e-7, "truss speeds": 1e-6}

Fixture = dict[str, Any]


def stored(name):
    with np.load(FOLDER / name) as file:
        return dict(file)


@pytest.fixture(scope="module")
def accelerations():
    return stored("accelerations.npz")


def truss_of(data, name, grasps=4):
    names = [key for key in data if key.startswith(f"{name}.")]
    fields = {key.removeprefix(f"{name}."): data[key] for key in names}
    of_grasps = {key: value[:grasps] for key, value in fields.items() if key.startswith("grasp")}
    return TrussModes(**{**fields, **of_grasps}, source="tests/models/exudyn")


def arms_of(names):
    return tuple({"literal": RobotArm.literal, "jaco": RobotArm.jaco}[name]() for name in names)


class ExponentialMap:
    """The rotation of a rotation vector, its rate and its bias, as series in s = c·c.

    For |c| < 0.3 rad six terms leave nothing. `axes` is 1 for the angular velocity in the
    undeformed frame, which is right there, and -1 for the turned frame, Exudyn's mistake.
    """

    first = (-1.0) ** np.arange(6) / [1, 6, 120, 5040, 362880, 39916800]  # sin(c) / c
    second = (-1.0) ** np.arange(6) / [2, 24, 720, 40320, 3628800, 479001600]  # (1 - cos c) / c²
    third = (-1.0) ** np.arange(6) / [6, 120, 5040, 362880, 39916800, 6227020800]

    def __init__(self, axes=1):
        self.axes = axes

    @staticmethod
    def _series(terms, s):
        value = terms[-1]
        for term in terms[-2::-1]:
            value = term + s * value
        return value

    def rotation(self, c):
        s, cross = c @ c, cross_matrix(c)
        once, twice = self._series(self.first, s), self._series(self.second, s)
        return np.eye(3) + once * cross + twice * (cross @ cross)

    def rate_matrix(self, c):
        s, cross = c @ c, self.axes * cross_matrix(c)
        once, twice = self._series(self.second, s), self._series(self.third, s)
        return np.eye(3) + once * cross + twice * (cross @ cross)

    def bias_acceleration(self, c, rate):
        s, ds = c @ c, 2.0 * (c @ rate)
        across, again = np.cross(c, rate), np.cross(c, np.cross(c, rate))
        powers = np.arange(1, 6)
        d_once = ds * self._series(powers * self.second[1:], s)
        d_twice = ds * self._series(powers * self.third[1:], s)
        change = np.cross(rate, across)
        return self.axes * d_once * across + d_twice * again + self._series(self.third, s) * change

    def replace_cayley(self, patch):
        patch.setattr(hand_motion, "cayley_rotation", self.rotation)
        patch.setattr(hand_motion, "cayley_rate_matrix", self.rate_matrix)
        patch.setattr(hand_motion, "cayley_bias_acceleration", self.bias_acceleration)


def kinds(joints):
    """Return the places of each kind of acceleration."""
    places = {"velocity": slice(0, 3), "spin": slice(3, 6), "modes": slice(6 + joints, None)}
    return {**places, "joints": slice(6, 6 + joints)} if joints else places


def relative(error, value, joints):
    return {
        kind: float(np.max(np.abs(error[place])) / np.max(np.abs(value[place])))
        for kind, place in kinds(joints).items()
    }


def difference(data, truss, case, *, exact=True):
    """Return the relative difference of accelerations by kind, and the residual of Exudyn's."""
    q, v, actuation, names = (data[f"{case}.{key}"] for key in ("q", "v", "actuation", "arms"))
    theirs = data[f"{case}.accelerations"][0]
    if len(names):
        modes = truss_of(data, truss, len(names))
        system = TrussDynamics(modes=modes, arms=arms_of(names), elastic_integrals=exact)
        terms = system.evaluate(q, v)
        mass, bias = terms.mass_matrix, terms.bias
        force = terms.actuation_matrix @ actuation + system.elastic_force(q, v)
    else:
        modes = truss_of(data, truss)
        used = np.concatenate([np.ones(1), q[6:]])[: None if exact else 1]
        own = truss_terms(modes.data, used, v[:3], v[3:6], v[6:])
        mass = np.block([[own.root, own.coupling], [own.coupling.T, np.eye(modes.modes)]])
        bias = np.concatenate([own.root_bias, own.modal_bias])
        force = np.concatenate(
            [
                np.zeros(6),
                -modes.stiffness * q[6:] - (4 * np.pi * modes.damping_ratios * modes.frequencies) * v[6:],
            ]
        )
    found = relative(np.linalg.solve(mass, force - bias) - theirs, theirs, 7 * len(names))
    scale = 1.0 / np.sqrt(np.diag(mass))
    rest = np.linalg.norm(scale * (mass @ theirs + bias - force))
    return {**found, "residual": float(rest / np.linalg.norm(scale * (force - bias)))}


def assert_agrees(found):
    for kind, error in found.items():
        limit = RESIDUAL if kind == "residual" else TOLERANCE[kind]
        assert error < limit, f"{kind}: {error:.2g}"


def slope(steps, errors):
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


def test_tolerances_are_as_large_as_exudyns_noise(accelerations):
    """Two steps of its differences: the results differ by less than the tolerances, not by far."""
    noise = dict.fromkeys(TOLERANCE, 0.0)
    for key, values in accelerations.items():
        joints = 7 * len(accelerations.get(f"{key.removesuffix('.accelerations')}.arms", []))
        if joints:
            for kind, error in relative(values[1] - values[0], values[0], joints).items():
                noise[kind] = max(noise[kind], error)
    for kind, error in noise.items():
        assert TOLERANCE[kind] / 10 < error < TOLERANCE[kind], f"{kind}: {error:.2g}"


@pytest.mark.parametrize("i", range(2))
def test_deformed_truss_alone(accelerations, i):
    found = difference(accelerations, "any_axis", f"alone.{i}")
    assert max(found.values()) < ALONE
    published = difference(accelerations, "any_axis", f"alone.{i}", exact=False)
    assert min(published.values()) > 0.01  # the deformation matters


@pytest.mark.parametrize("i", range(2))
@pytest.mark.parametrize("arms", [1, 4])
@pytest.mark.parametrize("exact", [True, False], ids=["exact", "published"])
def test_undeformed_truss_with_arms(accelerations, arms, i, *, exact):
    """The published integrals are exact here, at any modal rates."""
    assert_agrees(difference(accelerations, "any_axis", f"undeformed_{arms}.{i}", exact=exact))


@pytest.mark.parametrize("i", range(2))
def test_deformed_truss_with_hands_not_turned(accelerations, i):
    """Displacements of decimetres with R_i tau = 0, R_i tau' not: no convention is left."""
    assert_agrees(difference(accelerations, "any_axis", f"hands_not_turned.{i}"))


@pytest.mark.parametrize("i", range(5))
def test_hands_turned_about_one_axis(accelerations, i):
    """With the exponential map the equations are Exudyn's, at any deformation."""
    with pytest.MonkeyPatch.context() as patch:
        ExponentialMap().replace_cayley(patch)
        assert_agrees(difference(accelerations, "one_axis", f"deformed_one_axis.{i}"))


def test_cayleys_formula_differs_by_the_square_of_the_rotation(accelerations):
    """Deformation, speeds and inputs all scaled: four states, each half of the one before."""
    cases = [f"deformed_one_axis.{i}" for i in range(1, 5)]
    modes, rigid = truss_of(accelerations, "one_axis"), 34
    deformations = [accelerations[f"{case}.q"][rigid:] for case in cases]
    turned = np.array([np.max(np.abs(modes.grasp_rotations @ d)) for d in deformations])
    found = [difference(accelerations, "one_axis", case) for case in cases]
    for kind in TOLERANCE:
        order = slope(turned, [f[kind] for f in found])
        assert order == pytest.approx(2.0, abs=0.1), kind


def test_exudyns_marker_does_not_turn_at_the_rate_it_says(accelerations):
    """The derivative of Exudyn's own rotations is our rate; its rate is ours in turned axes."""
    found = {name: accelerations[f"marker.{name}"] for name in ("rotations", "step")}
    r = found["rotations"]
    derivative = (8.0 * (r[3] - r[1]) - (r[4] - r[0])) / (12.0 * found["step"]) @ r[2].T
    turns = np.array([derivative[2, 1], derivative[0, 2], derivative[1, 0]])
    turning = truss_of(accelerations, "any_axis").grasp_rotations[0]
    c, rate = (turning @ accelerations[f"marker.{name}"] for name in ("modal", "rates"))
    exponential = ExponentialMap()
    ours = exponential.rate_matrix(c) @ rate
    said = accelerations["marker.angular_velocity"]
    limit = 1e-9 * np.max(np.abs(ours))  # fourth-order differences of rotations by 1e-4 rad
    assert np.max(np.abs(ours - turns)) < limit
    assert np.max(np.abs(exponential.rotation(c).T @ ours - said)) < limit
    assert np.max(np.abs(ours - said)) > 0.01 * np.max(np.abs(ours))


@pytest.mark.parametrize("i", range(5))
def test_hands_turned_about_any_axis_at_exudyns_rate(accelerations, i):
    """With the mistake in our equations as well, nothing else differs."""
    with pytest.MonkeyPatch.context() as patch:
        ExponentialMap(axes=-1).replace_cayley(patch)
        assert_agrees(difference(accelerations, "any_axis", f"deformed_any_axis.{i}"))


def test_exudyns_mistake_is_of_first_order(accelerations):
    cases = [f"deformed_any_axis.{i}" for i in range(1, 5)]
    size = np.array([np.linalg.norm(accelerations[f"{case}.q"][34:]) for case in cases])
    found = [difference(accelerations, "any_axis", case) for case in cases]
    for kind in TOLERANCE:
        assert slope(size, [f[kind] for f in found]) == pytest.approx(1.0, abs=0.1), kind


@pytest.fixture(scope="module")
def exudyns_motion():
    return stored("motion.npz")


@pytest.fixture(scope="module")
def our_motion(exudyns_motion):
    """Return the motion from the same start under the same inputs, by a method of high order."""
    data = exudyns_motion
    system = TrussDynamics(
        modes=truss_of(data, "one_axis"), arms=arms_of(data["arms"]), elastic_integrals=True
    )
    diagram = Diagram("motion")
    truss, inputs = diagram.add(truss=SpaceTruss(system), forces=Constant(data["actuation"]))
    inputs.y >> truss.actuation
    times = data["times"]
    simulator = Simulator(
        diagram,
        solver="DOP853",
        rtol=1e-11,
        atol=1e-11,
        log=[truss.coordinates, truss.speeds],
        log_step=float(times[0]),
    )
    initial = {"truss.q": data["q"], "truss.v": data["v"]}
    result = simulator.run(float(times[-1]), initial=initial, progress=False)
    q, v = (result[f"truss.{name}"].values[1:] for name in ("coordinates", "speeds"))
    return {
        "positions": q[:, :3],
        "attitudes": np.array([euler_rotation(angles) for angles in q[:, 3:6]]),
        "joint_angles": q[:, 6:34],
        "modal": q[:, 34:],
        "truss speeds": v[:, :6],
    }


def runs_of(data, quantity):
    """Return Exudyn's samples of a quantity, from the longest step to the shortest."""
    runs: Vector = data["speeds"][:, :, :6] if quantity == "truss speeds" else data[quantity]
    return runs


@pytest.mark.slow
@pytest.mark.parametrize("quantity", MOTION)
def test_exudyns_motion_converges_to_ours(exudyns_motion, our_motion, quantity):
    """Its trapezoidal rule has second order: so has its distance from our motion, at four steps."""
    errors = [float(np.max(np.abs(run - our_motion[quantity]))) for run in runs_of(exudyns_motion, quantity)]
    assert slope(exudyns_motion["steps"], errors) == pytest.approx(2.0, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("quantity", MOTION)
def test_motion_equals_exudyns_extrapolated(exudyns_motion, our_motion, quantity):
    """Extrapolated to step zero, it is as far from ours as it still changes, and no farther."""
    runs = runs_of(exudyns_motion, quantity)
    before, last = ((4.0 * runs[i] - runs[i - 1]) / 3.0 for i in (2, 3))
    change = float(np.max(np.abs(last - before)))
    assert change < MOTION[quantity]
    assert np.max(np.abs(last - our_motion[quantity])) < change
