"""Conservation laws, point by point: rates along the flow by complex steps, to round-off.

At a state (q, v) the flow is dq/dt = N v, dv/dt = M^-1 (P Q + F^E - b). The rate of a quantity
E(q, v) along it is Im E(q + i h dq/dt, v + i h dv/dt) / h, without truncation.
"""

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from trussflow.blocks.framework.types import Vector
from trussflow.blocks.tracing.linear_algebra import solve_positive_definite
from trussflow.blocks.tracing.tracing import symbol, to_expression
from trussflow.models import EULER, QUATERNION, RobotArm, TrussDynamics

# Of the sum of the powers that have to cancel; the solve with M costs two digits.
TOLERANCE = 1e-12
COMPLEX_STEP = 1e-40
ROUND_OFF = 1e-12  # of the energy, over 160 steps of four evaluations

State = Callable[[TrussDynamics], tuple[Vector, Vector]]
System = Callable[..., TrussDynamics]


def damping(modes):
    """Return the diagonal of the modal damping, 2 zeta (2 pi f) [1/s]."""
    return 4.0 * np.pi * modes.damping_ratios * modes.frequencies


def flow(system, q, v, force=0.0):
    """Return dq/dt and dv/dt under a generalized force, elastic and damping forces included."""
    terms = system.evaluate(q, v)
    right = force + system.elastic_force(q, v) - terms.bias
    return system.kinematics(q, v), np.linalg.solve(terms.mass_matrix, right)


def rate(function, q, v, dq, dv):
    """Return the rate of a quantity along the flow."""
    step = 1j * COMPLEX_STEP
    result: Vector = np.imag(function(q + step * dq, v + step * dv)) / COMPLEX_STEP
    return result


def power_scale(system, q, v):
    """Return the sum of the magnitudes of the powers of all inertial and elastic forces."""
    terms = system.evaluate(q, v)
    return float(np.abs(v) @ (np.abs(terms.bias) + np.abs(system.elastic_force(q, v))))


SYSTEMS = [((7,) * 4, 6), ((3,) * 6, 2), ((2, 5), 3), ((1,), 0)]


@pytest.mark.parametrize(("joints", "modes"), SYSTEMS)
def test_consistent_equations_conserve_energy(random_system, random_state, joints, modes):
    system = random_system(joints, modes, elastic_integrals=True)
    for _ in range(3):
        q, v = random_state(system)
        error = rate(system.energy, q, v, *flow(system, q, v))
        assert abs(error) < TOLERANCE * power_scale(system, q, v)


@pytest.mark.parametrize(("joints", "modes"), SYSTEMS)
def test_consistent_equations_conserve_momentum(random_system, random_state, joints, modes):
    system = random_system(joints, modes, elastic_integrals=True)

    def momentum(q, v):
        return np.concatenate(system.momentum(q, v))

    for _ in range(3):
        q, v = random_state(system)
        dq, dv = flow(system, q, v)
        # What has to cancel: the change through the speeds against the one through the place.
        scale = np.max(np.abs(rate(momentum, q, v, 0.0 * dq, dv)))
        assert np.max(np.abs(rate(momentum, q, v, dq, dv))) < TOLERANCE * scale


@pytest.mark.parametrize("attitude", [EULER, QUATERNION], ids=lambda kind: str(kind.name))
def test_any_arrangement_conserves_both(random_system, random_state, arrangement, attitude):
    """Robots of any kinds and number, joints that slide and none at all: same equations, any coordinates."""
    system = replace(random_system(*arrangement, elastic_integrals=True), attitude=attitude)

    def momentum(q, v):
        return np.concatenate(system.momentum(q, v))

    q, v = random_state(system)
    dq, dv = flow(system, q, v)
    assert abs(rate(system.energy, q, v, dq, dv)) < TOLERANCE * power_scale(system, q, v)
    scale = np.max(np.abs(rate(momentum, q, v, 0.0 * dq, dv)))
    assert np.max(np.abs(rate(momentum, q, v, dq, dv))) < TOLERANCE * scale
    # What the actuators do is their power: forces and torques on the bases, torques and forces of the joints.
    terms, actuation = system.evaluate(q, v), np.arange(1.0, system.actuators + 1.0)
    power = v @ terms.actuation_matrix @ actuation
    dq, dv = flow(system, q, v, terms.actuation_matrix @ actuation)
    scale = power_scale(system, q, v) + abs(power)
    assert abs(rate(system.energy, q, v, dq, dv) - power) < TOLERANCE * scale


def test_the_paper_s_system_made_consistent_conserves_both(consistent, random_state):
    q, v = random_state(consistent)
    dq, dv = flow(consistent, q, v)
    assert abs(rate(consistent.energy, q, v, dq, dv)) < TOLERANCE * power_scale(consistent, q, v)

    def momentum(q, v):
        return np.concatenate(consistent.momentum(q, v))

    scale = np.max(np.abs(rate(momentum, q, v, 0.0 * dq, dv)))
    assert np.max(np.abs(rate(momentum, q, v, dq, dv))) < TOLERANCE * scale


def test_consistent_power_balance_with_inputs_and_damping(consistent, random_state, rng):
    """dE/dt is the power of the actuators less what the damping takes."""
    system = TrussDynamics(modes=consistent.modes.damped(0.005), arms=consistent.arms, elastic_integrals=True)
    q, v = random_state(system)
    force = system.actuation_matrix(q) @ rng.standard_normal(system.actuators)
    modal_rates = v[system.rigid_coordinates :]
    power = v @ force - modal_rates @ (
        (4 * np.pi * system.modes.damping_ratios * system.modes.frequencies) * modal_rates
    )
    error = rate(system.energy, q, v, *flow(system, q, v, force)) - power
    assert abs(error) < TOLERANCE * power_scale(system, q, v)


def missing_power(modes, v, joints):
    """Return the power that the truncated integrals leave out, summed over the particles.

    v_t · (w × P tau') + w · (H_w tau'), that is the sum of m (v_t + w × r) · (w × T tau')
    rearranged: what the neglected change of S and J with tau would have supplied.
    """
    linear, angular, modal = v[:3], v[3:6], v[6 + joints :]
    swept = np.cross(angular, modes.shapes @ modal)
    moment = np.cross(modes.positions, swept)
    return float(modes.masses @ (swept @ linear + moment @ angular))


def test_published_equations_lose_a_known_power(without_grasp_rotation, random_state, rng):
    """Hands that do not turn with the truss: dE/dt = power - v·(w × P tau') - w·(H_w tau')."""
    system = TrussDynamics(
        modes=without_grasp_rotation.damped(0.01), arms=(RobotArm.literal(),) * 4, elastic_integrals=False
    )
    for _ in range(3):
        q, v = random_state(system)
        force = system.actuation_matrix(q) @ rng.standard_normal(system.actuators)
        modal_rates = v[system.rigid_coordinates :]
        power = v @ force - modal_rates @ (
            (4 * np.pi * system.modes.damping_ratios * system.modes.frequencies) * modal_rates
        )
        missing = missing_power(system.modes, v, system.joints)
        scale = power_scale(system, q, v)
        assert abs(missing) > 1e6 * TOLERANCE * scale  # or the test would show nothing
        error = rate(system.energy, q, v, *flow(system, q, v, force)) - (power - missing)
        assert abs(error) < TOLERANCE * scale


def test_published_energy_defect_of_turning_hands_is_of_first_order_in_deformation(published, random_state):
    """Eqs. 32-34 turn a hand at R tau' whatever tau: wrong by the order of R tau."""
    q, v = random_state(published)
    defects = []
    for factor in (1e-2, 1e-3, 1e-4):
        deformed = q.copy()
        deformed[published.rigid_coordinates :] *= factor
        energy_rate = rate(published.energy, deformed, v, *flow(published, deformed, v))
        defects.append(energy_rate + missing_power(published.modes, v, published.joints))
    slopes = np.diff(np.log10(np.abs(defects)))
    assert np.all(np.abs(slopes + 1.0) < 0.1)


def test_rigid_truss_conserves_in_both_variants(modes, random_state):
    """Without modes nothing is neglected, and the two variants are one."""
    systems = [
        TrussDynamics(modes=modes.rigid(), arms=(RobotArm.literal(),) * 4, elastic_integrals=e)
        for e in (False, True)
    ]
    q, v = random_state(systems[0])
    first, second = (system.evaluate(q, v) for system in systems)
    assert np.array_equal(first.mass_matrix, second.mass_matrix)
    assert np.array_equal(first.bias, second.bias)
    error = rate(systems[0].energy, q, v, *flow(systems[0], q, v))
    assert abs(error) < TOLERANCE * power_scale(systems[0], q, v)


def test_energy_along_a_run_converges_with_the_fourth_order(random_system):
    """RK4 on a tumbling, vibrating system: halving the step divides its errors by 16.

    The energy does better than the state, and reaches round-off at the third halving.
    """
    system = random_system((2,), 2, elastic_integrals=True)
    n = system.coordinates
    x = symbol("x", (2 * n,))
    q, v = x[:n], x[n:]
    terms = system.evaluate(q, v)
    acceleration = solve_positive_definite(terms.mass_matrix, system.elastic_force(q, v) - terms.bias)
    slope = np.concatenate([system.kinematics(q, v), acceleration])
    derivative = ca.Function("f", [to_expression(x)], [to_expression(slope)])

    def after(steps):
        state, h = np.concatenate([np.full(n, 0.2), np.full(n, 0.3)]), 1.0 / steps
        for _ in range(steps):
            k1 = derivative(state)
            k2 = derivative(state + h / 2 * k1)
            k3 = derivative(state + h / 2 * k2)
            k4 = derivative(state + h * k3)
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return np.asarray(state).ravel()

    reference = after(1280)
    runs = [after(steps) for steps in (20, 40, 80, 160)]
    errors = [np.linalg.norm(run - reference) for run in runs]
    slopes = -np.diff(np.log2(errors))
    assert np.all(np.abs(slopes - 4.0) < 0.1), slopes
    start = system.energy(np.full(n, 0.2), np.full(n, 0.3))
    drifts = [abs(system.energy(run[:n], run[n:]) / start - 1.0) for run in runs]
    assert drifts[1] < drifts[0] / 16.0
    assert drifts[-1] < ROUND_OFF
