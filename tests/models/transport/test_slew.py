"""Slews through any attitude: what the source's loop does with quaternions, against exact laws."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from systems import assert_near, respond

from trussflow.blocks import Diagram, Simulator, Step, simulate
from trussflow.models import QUATERNION, Hardware, ModelError, SpaceTruss
from trussflow.models.feasibility import fastest, single_failures, survey
from trussflow.models.transport import Mission, path_of, transport_diagram
from trussflow.models.transport.results import logged

ERROR_TOLERANCE = 1e-8  # by RK4 in steps of 5 ms, in rad
TURN = np.array([np.pi, 0.0, 0.0])  # through φ = 90°, and on


def mission(turn, duration=10.0):
    """Return a mission with a linear law, without what bounds its disturbances."""
    found = replace(
        Mission.of_case(1), exponent=1.0, switching_gain=0.0, duration=duration
    )
    return replace(found, position=np.array([1.0, -2.0, 0.5]), attitude=turn)


@pytest.fixture
def tug(random_system):
    """Return a rigid truss without symmetry between two modules, in some attitude."""
    truss = SpaceTruss(
        random_system(("", ""), 0, elastic_integrals=True)
    ).with_quaternion()
    return truss.turned(np.array([0.1, -0.7, 0.5, 0.5]))


def flown(flight, truss, *, turned=None, sign=1.0):
    """Return a flight for two durations, from where the path starts or turned beside it."""
    q = truss.parameters["initial_coordinates"]
    truss = SpaceTruss(truss.dynamics, start=q)
    diagram = transport_diagram(flight, truss, allocation="published")
    q = q.copy()
    q[3:7] = sign * QUATERNION.integrate(
        q[3:7], np.zeros(3) if turned is None else turned
    )
    simulator = Simulator(diagram, step=5e-3, log=logged(diagram), log_step=0.25)
    return simulator.run(2.0 * flight.duration, initial={"truss.q": q})


def test_a_slew_s_velocity_and_acceleration_are_its_derivatives(tug):
    path = path_of(mission(TURN + 0.2), tug)

    h = 1e-5
    for t in (2.0, 5.0, 7.0):
        now, before, after = (respond(path, time) for time in (t, t - h, t + h))
        slope, bend = (
            (after[k] - before[k]) / (2 * h) for k in ("position", "velocity")
        )
        rates = QUATERNION.rates(now["position"][3:], now["velocity"][3:])
        expected = np.concatenate([now["velocity"][:3], rates])
        assert_near(slope, expected, 1e-9)
        assert_near(bend, now["acceleration"], 1e-9)
    start, end = (
        Rotation.from_quat(respond(path, t)["position"][[4, 5, 6, 3]])
        for t in (0.0, 10.0)
    )
    assert_near(
        (start.inv() * end * Rotation.from_rotvec(TURN + 0.2).inv()).as_rotvec(),
        0.0,
        1e-14,
    )


def test_a_slew_through_the_singularity_is_followed(tug):
    """The model is exact, so nothing is left but what the solver leaves."""
    run = flown(mission(TURN), tug)
    assert_near(run["position_error"], 0.0, ERROR_TOLERANCE)
    assert_near(run["attitude_error"], 0.0, ERROR_TOLERANCE)
    first, last = (
        Rotation.from_quat(run["attitude"].values[i][[1, 2, 3, 0]]) for i in (0, -1)
    )
    assert (first.inv() * last).magnitude() == pytest.approx(np.pi, abs=ERROR_TOLERANCE)


@pytest.mark.parametrize(
    "angle", [2.9, 4.0], ids=["far", "farther: the other way is shorter"]
)
def test_errors_of_any_size_converge_as_designed(tug, angle):
    r"""About one axis, with θ'' = -γ θ' - 2 μ sin(θ/2), whatever the path does, and by either quaternion."""
    flight, axis = mission(TURN), np.array([2.0, -1.0, 2.0]) / 3.0
    run, again = (
        flown(flight, tug, turned=angle * axis, sign=sign) for sign in (1.0, -1.0)
    )
    way = angle if angle < np.pi else angle - 2 * np.pi

    def law(_, y):
        return [
            y[1],
            -flight.rate_gain * y[1] - 2.0 * flight.error_gain * np.sin(y[0] / 2.0),
        ]

    time = run["time"].values
    exact = solve_ivp(
        law, (0.0, time[-1]), [way, 0.0], t_eval=time, rtol=1e-11, atol=1e-12
    ).y[0]
    for each in (run, again):
        expected = np.outer(2.0 * np.sin(exact / 2.0), axis)
        assert_near(each["attitude_error"], expected, ERROR_TOLERANCE)
    assert np.abs(exact[-1]) < 1e-2
    assert again["attitude"].values[0] == pytest.approx(-run["attitude"].values[0])


def test_a_slew_that_becomes_slower_ends_where_it_should(tug):
    """With half the acceleration left at half the way, position and velocity still belong together."""
    path = path_of(mission(TURN), tug, 0.01)
    diagram = Diagram("slower")
    _, left = diagram.add(slew=path, left=Step(5.0, initial_value=1.0, final_value=0.5))
    left.y >> path.share
    log = {"position": path.position, "velocity": path.velocity}
    run = simulate(diagram, 30.0, step=0.01, log=log, backend="interpreted")
    q, v = run["position"].values, run["velocity"].values
    turns = [
        QUATERNION.difference(*pair) / 0.02
        for pair in zip(q[:-2, 3:], q[2:, 3:], strict=True)
    ]
    assert_near(turns, v[1:-1, 3:], 1e-4)  # h², and the corner
    assert v[1600, 3] > 0.0
    end = path_of(
        mission(TURN),
        SpaceTruss(tug.dynamics, start=tug.parameters["initial_coordinates"]),
    )
    assert_near(q[-1], respond(end, 10.0)["position"], ERROR_TOLERANCE)


def test_what_actuators_need_for_a_turn_about_z_is_the_same():
    """Turns about inertial z are the same path with Euler angles; those through φ = 90° need a quaternion."""
    truss = SpaceTruss.consistent(modes=0)
    limits = Hardware.flight().limits(truss)
    ours, turn = truss.with_quaternion(), np.array([0.0, 0.0, 2.0])
    whole = single_failures(truss.dynamics)[:1]
    one, other = (
        survey(each.dynamics, path_of(mission(turn), each), limits, whole)[
            0
        ].least_duration
        for each in (truss, ours)
    )
    assert other == pytest.approx(one, rel=1e-9)
    with pytest.raises(ModelError, match="or a truss with a quaternion"):
        survey(truss.dynamics, path_of(mission(TURN), truss), limits, whole)
    (found,) = survey(ours.dynamics, path_of(mission(TURN), ours), limits, whole)
    assert found.least_duration > 10.0
    assert "nan" not in str(found)
    with pytest.raises(ModelError, match=r"waypoints has shape \(2, 6\); it must be"):
        fastest(ours, np.eye(6)[:2], limits)
