"""The flexible equations against a second code, Exudyn, by its stored accelerations.

Exudyn models the truss as a floating frame with modes of its nodal mass and stiffness matrix,
and each robot as nine bodies with absolute coordinates and constraints between them. Its results are
stored in the folder exudyn, beside the scripts that made them.

The two codes differ in one convention. Exudyn turns a hand by the exponential of the elastic
rotation vector c, this package by Cayley's formula; both are I + c× + O(c²), and accelerations
differ by the order of c². With the exponential in Cayley's place the equations are the same.

Exudyn 1.13 also makes a mistake: where a marker holds a hand, it takes the components of the
hand's angular velocity in the turned axes for components in the truss frame, which is wrong by
c × c'. The mistake has no effect where c = 0, and where a hand turns about one axis only. So one set of
modes, "one_axis", is made such that each held frame of the truss turns about one axis; the
other, "any_axis", are the truss's own modes.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from systems import assert_near, relative_error

from trussflow.models import RobotArm, TrussDynamics, TrussModes
from trussflow.models.robots import hand_motion

FOLDER = Path(__file__).parent / "exudyn"

# Of the largest acceleration of a kind. For the acceleration of its joints Exudyn differentiates
# their Jacobians numerically; another step of these differences changes its results by up to a half
# of these tolerances.
TOLERANCE = {"velocity": 3e-9, "spin": 3e-9, "joints": 3e-8, "modes": 3e-9}
# The truss alone has no joint, and nothing is differentiated: round-off of a matrix whose
# condition number is 1e4.
TOLERANCE_ALONE = dict.fromkeys(("velocity", "spin", "modes"), 1e-11)


@pytest.fixture(scope="module")
def stored():
    return np.load(FOLDER / "accelerations.npz")


def system_of(data, truss, names, *, exact=True):
    """Return the equations of a stored truss with the named arms at its first grasps."""
    fields = {
        key.removeprefix(f"{truss}."): data[key]
        for key in data
        if key.startswith(f"{truss}.")
    }
    grasps = {
        key: value[: len(names)]
        for key, value in fields.items()
        if key.startswith("grasp")
    }
    modes = TrussModes(**fields | grasps, source="Exudyn")
    arms = tuple(getattr(RobotArm, name)() for name in names)
    return TrussDynamics(modes=modes, arms=arms, elastic_integrals=exact)


def assert_agrees(errors, tolerance=TOLERANCE):
    for kind, error in errors.items():
        assert error < tolerance[kind], kind


def errors(data, truss, case, *, exact=True):
    """Return the relative difference of accelerations by kind."""
    q, v, actuation, names, theirs = (
        data[f"{case}.{key}"]
        for key in ("q", "v", "actuation", "arms", "accelerations")
    )
    system = system_of(data, truss, names, exact=exact)
    terms = system.evaluate(q, v)
    force = terms.actuation_matrix @ actuation + system.elastic_force(q, v) - terms.bias
    ours = np.linalg.solve(terms.mass_matrix, force)
    first = 6 + system.joints
    kinds = {"velocity": slice(0, 3), "spin": slice(3, 6), "modes": slice(first, None)}
    if system.joints:
        kinds["joints"] = slice(6, first)
    return {
        kind: relative_error(ours[place], theirs[place])
        for kind, place in kinds.items()
    }


@pytest.mark.parametrize("i", range(2))
def test_deformed_truss_alone(stored, i):
    assert_agrees(errors(stored, "any_axis", f"alone.{i}"), TOLERANCE_ALONE)


@pytest.mark.parametrize("i", range(2))
@pytest.mark.parametrize("arms", [1, 4])
@pytest.mark.parametrize("exact", [True, False], ids=["exact", "published"])
def test_undeformed_truss_with_arms(stored, arms, i, exact):
    """The published integrals are exact here, at any modal rates."""
    assert_agrees(errors(stored, "any_axis", f"undeformed_{arms}.{i}", exact=exact))


@pytest.mark.parametrize("i", range(2))
def test_deformed_truss_with_hands_not_turned(stored, i):
    """Displacements of decimetres with R_i tau = 0, R_i tau' not: no convention is left."""
    assert_agrees(errors(stored, "any_axis", f"hands_not_turned.{i}"))


@pytest.mark.parametrize("i", range(5))
def test_hands_turned_about_one_axis(stored, monkeypatch, i):
    """With the exponential map the equations are Exudyn's, at any deformation."""
    monkeypatch.setattr(
        hand_motion, "cayley_rotation", lambda c: Rotation.from_rotvec(c).as_matrix()
    )
    # About one axis the angular velocity is the rate of the angle.
    monkeypatch.setattr(hand_motion, "cayley_rate_matrix", lambda *_: np.eye(3))
    monkeypatch.setattr(hand_motion, "cayley_bias_acceleration", lambda *_: np.zeros(3))
    assert_agrees(errors(stored, "one_axis", f"deformed_one_axis.{i}"))


def test_cayleys_formula_differs_by_the_square_of_the_rotation(stored):
    """Deformation, speeds and inputs all scaled: four states, each half of the one before."""
    differences = [
        errors(stored, "one_axis", f"deformed_one_axis.{i}") for i in range(1, 5)
    ]
    for kind in TOLERANCE:
        orders = -np.diff(np.log2([each[kind] for each in differences]))
        assert_near(orders, 2.0, 0.1)
