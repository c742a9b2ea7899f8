"""Filters designed from diagrams and linear models: the right matrices, names and times."""

import control
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import block_diag
from systems import DrivenPendulum, assert_near

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    GaussMarkov,
    Input,
    OperatingPoint,
    Output,
    State,
    StateSpace,
    from_control,
    kalman_filter,
    linearize,
)
from trussflow.blocks.control import ExtendedKalmanFilter, KalmanFilter
from trussflow.blocks.control.covariances import sampled_covariance

ROUND_OFF = 1e-12
EVERY = 0.02  # s


class TwoMasses(Block):
    """A cart of 2 kg and a load of 1 kg with a spring between them."""

    force = Input(unit="N")
    wind = Input(unit="N")
    cart = Output(unit="m")
    accelerometer = Output(unit="m/s^2")
    position = State(2, unit="m")
    velocity = State(2, unit="m/s")

    def _rates(self, x, u):
        spring = 20.0 * (x.position[1] - x.position[0]) + 0.3 * (
            x.velocity[1] - x.velocity[0]
        )
        return np.stack([(u.force + spring) / 2.0, u.wind - spring])

    def output(self, t, x, u, p):
        return {"cart": x.position[0], "accelerometer": self._rates(x, u)[1]}

    def derivative(self, t, x, u, p):
        return {"position": x.velocity, "velocity": self._rates(x, u)}


A = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-10, 10, -0.15, 0.15], [20, -20, 0.3, -0.3]])
B = np.array([[0, 0], [0, 0], [0.5, 0], [0, 1]])
C = np.array([[1.0, 0, 0, 0]])
SETTINGS = {
    "measured": "cart",
    "inputs": "force",
    "every": EVERY,
    "measurement_noise": 1e-6,
    "process_noise": {"velocity": [1e-6, 2e-6]},
}


def carried():
    diagram = Diagram("carried")
    masses = diagram.add(masses=TwoMasses())
    diagram.expose(force=masses.force, wind=masses.wind, cart=masses.cart)
    return diagram


def test_plant_is_sampled_exactly_with_its_disturbances():
    block = kalman_filter(
        TwoMasses(),
        **SETTINGS,
        disturbances={
            "wind": GaussMarkov(0.4, 5.0),
            "cart": GaussMarkov(1e-3, 2.0),
            "velocity[0]": 1e-4,
        },
    )
    wide = block_diag(A, np.diag([-0.2, -0.5, 0.0]))
    wide[3, 4], wide[2, 6] = 1.0, 1.0
    sampled = control.c2d(
        control.ss(wide, np.vstack([B, np.zeros((3, 2))])[:, :1], np.eye(7), 0), EVERY
    )
    process = block.process
    assert_near(process.A, sampled.A, ROUND_OFF)
    assert_near(process.B, sampled.B, ROUND_OFF)
    assert_array_equal(process.C, [[1, 0, 0, 0, 0, 1, 0]])
    density = np.diag([0, 0, 1e-6, 2e-6, 2 * 0.4**2 / 5.0, 1e-6, 1e-4])
    assert_near(process.covariance, sampled_covariance(wide, density, EVERY), 1e-18)
    assert block.state_names == (
        "TwoMasses/position[0]",
        "TwoMasses/position[1]",
        "TwoMasses/velocity[0]",
        "TwoMasses/velocity[1]",
        "disturbance/wind",
        "disturbance/cart",
        "disturbance/TwoMasses/velocity[0]",
    )
    assert block.measurement.unit == ("m",)
    assert block.command.unit == ("N",)


@pytest.fixture(name="block", scope="module")
def block_fixture():
    return kalman_filter(carried(), **SETTINGS, disturbances={"wind": 1e-3})


@pytest.mark.parametrize(
    "name, elements",
    [
        ("masses.position", [0, 1]),
        ("velocity", [2, 3]),
        ("velocity[1]", 3),
        ("masses.velocity[0:1]", [2]),
        ("disturbance.wind", 4),
        ("wind", 4),
    ],
)
def test_states_are_wired_by_name(block, name, elements):
    assert block.of(name).elements().tolist() == elements
    assert block.of(name, "prediction").name == "prediction"


def test_a_linear_model_gives_the_same_filter(block):
    model = linearize(carried(), ["force", "wind"], ["cart"])
    settings = SETTINGS | {"measured": "y", "inputs": "u[0]"}
    settings["process_noise"] = {"x[2:4]": SETTINGS["process_noise"]["velocity"]}
    same = kalman_filter(from_control(model), **settings, disturbances={"u[1]": 1e-3})
    assert_allclose(same.gain, block.gain, rtol=1e-12)


def test_what_drives_a_command_in_the_diagram_is_cut_off():
    loop = Diagram("closed loop")
    loop.add(
        masses=TwoMasses(),
        law=StateSpace([[-1.0]], [1.0], [-3.0]),
        calm=Constant(0.0, unit="N"),
    )
    loop.masses.cart >> loop.law >> loop.masses.force
    loop.calm >> loop.masses.wind
    # The state of the law is visible through the cut wire only, and decays.
    wires = {"measured": "masses.cart", "inputs": "masses.force"}
    block = kalman_filter(loop, **SETTINGS | wires)
    masses = [
        k for k, name in enumerate(block.state_names) if name.startswith("masses")
    ]
    reference = kalman_filter(TwoMasses(), **SETTINGS)
    assert_allclose(block.gain[masses], reference.gain, rtol=1e-9)


@pytest.mark.parametrize("kind", ["steady", "varying", "extended"])
def test_signals_are_absolute_at_any_operating_point(kind, follow):
    """An arm held up by its motor stays where it is, also before the first command arrives."""
    held = 9.81 * np.sin(1.0)
    block = kalman_filter(
        DrivenPendulum(),
        inputs="drive",
        every=EVERY,
        measurement_noise=1e-6,
        process_noise={"v": 1e-4},
        disturbances={"wind": 1e-4},
        command_delay=0.06,
        measurement_delay=0.04,
        kind=kind,
        initial_covariance=None
        if kind == "steady"
        else {"q": 1e-6, "disturbance.wind": 1e-2},
        at=OperatingPoint(states={"DrivenPendulum.q": 1.0}, inputs={"drive": held}),
    )
    found = follow(block, np.full((50, 1), np.sin(1.0)), np.full((50, 1), held))
    for name in ("estimate", "prediction"):
        assert_near(found[name], np.tile([1.0, 0, 0], (50, 1)), ROUND_OFF)
    assert type(block) is (KalmanFilter if kind == "steady" else ExtendedKalmanFilter)


def test_a_point_that_is_no_equilibrium_drifts(follow):
    """Falling from where it is linearized, a pendulum is predicted as its tangent model falls."""
    block = kalman_filter(
        DrivenPendulum(),
        inputs="drive",
        every=EVERY,
        measurement_noise=1e-6,
        process_noise={"v": 1e-4},
        measurement_delay=EVERY,
        at=OperatingPoint(states={"DrivenPendulum.q": 1.0}),
    )
    found = follow(block, np.full((1, 1), np.sin(1.0)), np.zeros((1, 1)))
    tangent = control.c2d(
        control.ss(
            [[0, 1], [-9.81 * np.cos(1.0), -0.1]],
            [[0], [-9.81 * np.sin(1.0)]],
            np.eye(2),
            0,
        ),
        EVERY,
    )
    assert_near(found["estimate"][0], [1.0, 0.0] + tangent.B[:, 0], ROUND_OFF)


def test_extended_filter_of_a_linear_diagram_is_the_time_varying_one(follow, rng):
    """But for the error of RK4, and of Simpson's rule for the noise, both of fourth order."""
    y, u = rng.normal(size=(60, 1)), rng.normal(size=(60, 1))
    settings = SETTINGS | {
        "disturbances": {"wind": GaussMarkov(0.4, 5.0)},
        "initial_covariance": 0.1,
    }
    exact = follow(kalman_filter(carried(), **settings, kind="varying"), y, u)
    errors = []
    for steps in (1, 2, 4):
        found = follow(
            kalman_filter(carried(), **settings, kind="extended", steps=steps), y, u
        )
        errors.append(np.abs(found["estimate"] - exact["estimate"]).max())
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(4.0, abs=0.1)
