"""Conservation laws, point by point: rates along the flow by complex steps, to round-off.

At a state (q, v) the flow is dq/dt = N v, dv/dt = M^-1 (P Q + F^E - b). The rate of a quantity
E(q, v) along it is Im E(q + i h dq/dt, v + i h dv/dt) / h, without truncation.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from systems import assert_near

from trussflow.models import EULER, QUATERNION, RobotArm, TrussDynamics

# Of the sum of the powers that have to cancel; the solve with M costs two digits.
TOLERANCE = 1e-12
COMPLEX_STEP = 1e-40


def flow(system, q, v, force=0.0):
    """Return dq/dt and dv/dt under a generalized force, elastic and damping forces included."""
    terms = system.evaluate(q, v)
    right = force + system.elastic_force(q, v) - terms.bias
    return system.kinematics(q, v), np.linalg.solve(terms.mass_matrix, right)


def energy(system, q, v):
    """Return the kinetic and elastic energy."""
    modal = q[system.rigid_coordinates :]
    elastic = modal @ (system.modes.stiffness * modal)
    return (v @ system.evaluate(q).mass_matrix @ v + elastic) / 2.0


def rate(function, q, v, dq, dv):
    """Return the rate of a quantity along the flow."""
    step = 1j * COMPLEX_STEP
    return np.imag(function(q + step * dq, v + step * dv)) / COMPLEX_STEP


def power_scale(system, q, v):
    """Return the sum of the magnitudes of the powers of all inertial and elastic forces."""
    terms = system.evaluate(q, v)
    return np.abs(v) @ (np.abs(terms.bias) + np.abs(system.elastic_force(q, v)))


def external_power(system, q, v, actuation):
    """Return the generalized force of the actuators, and their power less the power of the damping."""
    force, rates = (
        system.evaluate(q).actuation_matrix @ actuation,
        v[system.rigid_freedoms :],
    )
    damping = 4 * np.pi * system.modes.damping_ratios * system.modes.frequencies
    return force, v @ force - rates @ (damping * rates)


@pytest.mark.parametrize(
    "attitude", [EULER, QUATERNION], ids=lambda kind: str(kind.name)
)
def test_any_arrangement_conserves_both(
    random_system, random_state, arrangement, attitude
):
    """Momentum is constant; the rate of the energy is the power of the actuators less that of the damping."""
    system = replace(
        random_system(*arrangement, elastic_integrals=True), attitude=attitude
    )
    system = replace(system, modes=system.modes.damped(0.005))

    def momentum(q, v):
        return np.concatenate(system.momentum(q, v))

    q, v = random_state(system)
    dq, dv = flow(system, q, v)
    # Two parts have to cancel: the change through the speeds, and the one through the place.
    scale = np.max(np.abs(rate(momentum, q, v, 0.0 * dq, dv)))
    assert_near(rate(momentum, q, v, dq, dv), 0.0, TOLERANCE * scale)
    for factor in (0.0, 1.0):
        force, power = external_power(
            system, q, v, factor * np.arange(1.0, system.actuators + 1.0)
        )
        error = rate(partial(energy, system), q, v, *flow(system, q, v, force)) - power
        assert abs(error) < TOLERANCE * (power_scale(system, q, v) + abs(power))


def missing_power(modes, v, joints):
    """Return the power that the truncated integrals leave out, summed over the particles.

    v_t · (w × P tau') + w · (H_w tau'), that is the sum of m (v_t + w × r) · (w × T tau')
    rearranged: what the neglected change of S and J with tau would have supplied.
    """
    linear, angular, modal = v[:3], v[3:6], v[6 + joints :]
    swept = np.cross(angular, modes.shapes @ modal)
    moment = np.cross(modes.positions, swept)
    return modes.masses @ (swept @ linear + moment @ angular)


def test_published_equations_lose_a_known_power(
    without_grasp_rotation, random_state, rng
):
    """Hands that do not turn with the truss: dE/dt = power - v·(w × P tau') - w·(H_w tau')."""
    system = TrussDynamics(
        modes=without_grasp_rotation.damped(0.01),
        arms=(RobotArm.literal(),) * 4,
        elastic_integrals=False,
    )
    q, v = random_state(system)
    force, power = external_power(system, q, v, rng.standard_normal(system.actuators))
    missing = missing_power(system.modes, v, system.joints)
    scale = power_scale(system, q, v)
    assert abs(missing) > 1e6 * TOLERANCE * scale  # or the test would show nothing
    error = rate(partial(energy, system), q, v, *flow(system, q, v, force)) - (
        power - missing
    )
    assert abs(error) < TOLERANCE * scale


def test_published_energy_defect_of_turning_hands_is_of_first_order_in_deformation(
    published, random_state
):
    """Eqs. 32-34 turn a hand at R tau' whatever tau: wrong by the order of R tau."""
    q, v = random_state(published)
    defects = []
    for factor in (1e-2, 1e-3, 1e-4):
        deformed = q.copy()
        deformed[published.rigid_coordinates :] *= factor
        energy_rate = rate(
            partial(energy, published), deformed, v, *flow(published, deformed, v)
        )
        defects.append(
            energy_rate + missing_power(published.modes, v, published.joints)
        )
    slopes = np.diff(np.log10(np.abs(defects)))
    assert np.all(np.abs(slopes + 1.0) < 0.1)
