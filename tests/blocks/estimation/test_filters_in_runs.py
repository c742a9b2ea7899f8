"""Filters in diagrams: every backend gives the same numbers, an FMU the very same."""

from typing import Any

import numpy as np
import pytest

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    Gain,
    Input,
    Integrator,
    Noise,
    Output,
    Sine,
    State,
    UnitDelay,
    ZeroOrderHold,
    kalman_filter,
    simulate,
)
from trussflow.fmu import Fmu, export

EVERY = 0.02  # s


class Arm(Block):
    """A pendulum with a motor and an unknown torque, seen from the side."""

    torque = Input(unit="N*m")
    wind = Input(unit="N*m")
    shadow = Output()
    q = State(unit="rad", initial=0.2)
    v = State(unit="rad/s")

    def output(self, t, x, u, p):
        return {"shadow": np.sin(x.q)}

    def derivative(self, t, x, u, p):
        return {"q": x.v, "v": u.torque + u.wind - 9.81 * np.sin(x.q) - 0.1 * x.v}


def designed(kind):
    return kalman_filter(
        Arm(),
        "shadow",
        "torque",
        every=EVERY,
        measurement_noise=1e-6,
        process_noise={"v": 1e-4},
        disturbances={"wind": 1e-2},
        command_delay=EVERY,
        measurement_delay=2 * EVERY,
        kind=kind,
        initial_covariance=None if kind == "steady" else {"q": 0.1, "disturbance.wind": 1e-2},
    )


def loop(block, prediction):
    """Return an arm whose motor brakes by the rate that the filter predicts."""
    diagram = Diagram("observed")
    diagram.add(arm=Arm(), filter=block, brake=Gain(-2.0, input_unit="1", output_unit="N*m"))
    diagram.add(wind=Noise(0.3, 0.1, seed=1, unit="N*m"), noise=Noise(1e-3, EVERY, seed=2))
    diagram.add(sensor=ZeroOrderHold(EVERY), late=UnitDelay(EVERY, shape=()), later=UnitDelay(EVERY))
    diagram.add(under_way=UnitDelay(EVERY, shape=()))
    (diagram.arm.shadow + diagram.noise.y) >> diagram.sensor >> diagram.late >> diagram.later
    diagram.later.y >> diagram.filter.measurement[0]
    prediction(diagram.filter) >> diagram.brake
    diagram.brake.y >> diagram.filter.command[0]
    diagram.brake.y >> diagram.under_way
    diagram.under_way.y >> diagram.arm.torque
    diagram.wind >> diagram.arm.wind
    return diagram


SETTINGS: dict[str, Any] = {"step": 1e-3, "log_step": EVERY, "progress": False}
KINDS = ["steady", "varying", "extended"]


@pytest.mark.parametrize("kind", KINDS)
def test_backends_agree(kind):
    results = [
        simulate(loop(designed(kind), lambda f: f.of("v", "prediction")), 2.0, backend=backend, **SETTINGS)
        for backend in ("numpy", "interpreted", "compiled")
    ]
    for name in ("estimate", "prediction", "innovation"):
        reference, *others = (result[f"filter.{name}"].values for result in results)
        assert np.abs(reference).max() > 1e-3
        for found in others:
            np.testing.assert_allclose(found, reference, rtol=0, atol=1e-11)


class Cart(Block):
    """A cart of 2 kg in a constant wind."""

    force = Input(unit="N")
    wind = Input(unit="N")
    position = Output(unit="m")
    q = State(unit="m", initial=1.0)
    v = State(unit="m/s", initial=-0.5)

    def output(self, t, x, u, p):
        return {"position": x.q}

    def derivative(self, t, x, u, p):
        return {"q": x.v, "v": (u.force + u.wind) / 2.0}


@pytest.mark.parametrize("kind", KINDS)
def test_without_noise_everything_is_found_exactly(kind):
    """So instants, commands and delays are those of the run: one sample of difference costs millimetres."""
    block = kalman_filter(
        Cart(),
        inputs="force",
        every=EVERY,
        measurement_noise=1e-6,
        process_noise={"v": 1e-3},
        disturbances={"wind": 1e-2},
        command_delay=EVERY,
        measurement_delay=2 * EVERY,
        kind=kind,
        initial_covariance=None if kind == "steady" else 1.0,
    )
    diagram = Diagram("without noise")
    diagram.add(cart=Cart(), filter=block, force=Sine(3.0, 0.5, unit="N"), wind=Constant(0.7, unit="N"))
    diagram.add(hold=ZeroOrderHold(EVERY), under_way=UnitDelay(EVERY), sensor=ZeroOrderHold(EVERY))
    diagram.add(late=UnitDelay(EVERY), later=UnitDelay(EVERY), speed=Integrator(shape=()))
    diagram.force >> diagram.hold >> diagram.under_way >> diagram.cart.force
    diagram.wind >> diagram.cart.wind
    diagram.hold.y >> diagram.filter.command[0]
    diagram.cart.position >> diagram.sensor >> diagram.late >> diagram.later
    diagram.later.y >> diagram.filter.measurement[0]
    diagram.filter.of("disturbance.wind") >> diagram.speed
    result = simulate(diagram, 20.0, **SETTINGS)
    estimate, position = result["filter.estimate"].values, result["cart.position"].values
    np.testing.assert_allclose(estimate[-100:, 0], position[-100:], rtol=0, atol=1e-9)
    np.testing.assert_allclose(estimate[-100:, 2], 0.7, rtol=0, atol=1e-9)
    ahead = result["filter.prediction"].values[-100:-1, 0]
    np.testing.assert_allclose(ahead, position[-99:], rtol=0, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_fmu_of_a_controller_gives_the_same_numbers_bit_by_bit(kind, tmp_path):
    """The same programs; between other neighbours (below) the compiler may round otherwise."""

    def controller():
        diagram = Diagram("controller")
        diagram.add(
            filter=designed(kind), brake=Gain(-2.0, output_unit="N*m"), shown=Noise([1e-3], EVERY, seed=2)
        )
        diagram.shown >> diagram.filter.measurement
        diagram.filter.of("v", "prediction") >> diagram.brake
        diagram.brake.y >> diagram.filter.command[0]
        diagram.expose(estimate=diagram.filter.estimate, command=diagram.brake.y)
        return diagram

    path = export(controller(), tmp_path / "c.fmu", step=EVERY)
    settings: dict[str, Any] = {"step": EVERY, "progress": False}
    top = Diagram("top")
    top.add(c=Fmu(path, step=EVERY))
    ours, theirs = simulate(controller(), 4.0, backend="compiled", **settings), simulate(top, 4.0, **settings)
    np.testing.assert_array_equal(theirs["c.estimate"], ours["filter.estimate"])
    np.testing.assert_array_equal(theirs["c.command"], ours["brake.y"])


def test_fmu_of_the_filter_alone(tmp_path):
    path = export(designed("steady"), tmp_path / "filter.fmu", version="3.0", step=EVERY)
    results = [
        simulate(loop(block, lambda f: f.prediction[1]), 2.0, **SETTINGS)
        for block in (designed("steady"), Fmu(path, step=EVERY))
    ]
    for name in ("estimate", "prediction", "innovation"):
        ours, theirs = (result[f"filter.{name}"].values for result in results)
        np.testing.assert_allclose(theirs, ours, rtol=0, atol=1e-13)
