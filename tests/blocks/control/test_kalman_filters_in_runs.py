"""Filters in diagrams: every backend gives the same numbers, an FMU the very same."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import DrivenPendulum, assert_near, series

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    Gain,
    Input,
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
KINDS = ["steady", "varying", "extended"]
SETTINGS = {"step": 1e-3, "log_step": EVERY, "progress": False}


class Cart(Block):
    """A cart of 2 kg."""

    drive = Input(unit="N")
    wind = Input(unit="N")
    measured = Output(unit="m")
    q = State(unit="m", initial=1.0)
    v = State(unit="m/s", initial=-0.5)

    def output(self, t, x, u, p):
        return {"measured": x.q}

    def derivative(self, t, x, u, p):
        return {"q": x.v, "v": (u.drive + u.wind) / 2.0}


def designed(kind, plant):
    return kalman_filter(
        plant,
        "measured",
        "drive",
        every=EVERY,
        measurement_noise=1e-6,
        process_noise={"v": 1e-3},
        disturbances={"wind": 1e-2},
        command_delay=EVERY,
        measurement_delay=2 * EVERY,
        kind=kind,
        initial_covariance=None
        if kind == "steady"
        else {"q": 0.1, "disturbance.wind": 1e-2},
    )


def observed(plant, block, command, wind, noise):
    """Return a plant with its filter: the command is one sample late, the measurement two."""
    diagram = Diagram("observed")
    diagram.add(plant=plant, filter=block, command=command, wind=wind, noise=noise)
    diagram.add(
        sensor=ZeroOrderHold(EVERY), late=UnitDelay(EVERY), later=UnitDelay(EVERY)
    )
    diagram.add(under_way=UnitDelay(EVERY))
    (
        (diagram.plant.measured + diagram.noise.y)
        >> diagram.sensor
        >> diagram.late
        >> diagram.later
    )
    diagram.later.y >> diagram.filter.measurement[0]
    diagram.command.y >> diagram.filter.command[0]
    diagram.command >> diagram.under_way >> diagram.plant.drive
    diagram.wind >> diagram.plant.wind
    return diagram


def loop(block):
    """Return an arm whose motor brakes by the rate that the filter predicts."""
    brake = Gain(-2.0, input_unit="1", output_unit="N*m")
    wind, noise = Noise(0.3, 0.1, seed=1, unit="N*m"), Noise(1e-3, EVERY, seed=2)
    diagram = observed(DrivenPendulum(), block, brake, wind, noise)
    diagram.filter.prediction[1] >> brake
    return diagram


@pytest.mark.parametrize("kind", KINDS)
def test_backends_agree(kind):
    results = [
        simulate(
            loop(designed(kind, DrivenPendulum())), 0.5, backend=backend, **SETTINGS
        )
        for backend in ("numpy", "interpreted", "compiled")
    ]
    for name in ("estimate", "prediction", "innovation"):
        reference, *others = (result[f"filter.{name}"].values for result in results)
        assert np.abs(reference).max() > 1e-3
        for found in others:
            assert_near(found, reference, 1e-11)


@pytest.mark.parametrize("kind", KINDS)
def test_without_noise_everything_is_found_exactly(kind):
    """So instants, commands and delays are those of the run: one sample of difference costs millimetres."""
    wind, silence, hold = (
        Constant(0.7, unit="N"),
        Constant(0.0, unit="m"),
        ZeroOrderHold(EVERY),
    )
    diagram = observed(Cart(), designed(kind, Cart()), hold, wind, silence)
    diagram.add(force=Sine(3.0, 0.5, unit="N")) >> hold
    result = simulate(diagram, 20.0, **SETTINGS)
    estimate, position = (
        result["filter.estimate"].values,
        result["plant.measured"].values,
    )
    assert_near(estimate[-100:, 0], position[-100:], 1e-9)
    assert_near(estimate[-100:, 2], 0.7, 1e-9)
    ahead = result["filter.prediction"].values[-100:-1, 0]
    assert_near(ahead, position[-99:], 1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_fmu_of_a_controller_gives_the_same_numbers_bit_by_bit(kind, tmp_path):
    """The same programs; between other neighbours (below) the compiler may round otherwise."""

    def controller():
        diagram = Diagram("controller")
        diagram.add(
            filter=designed(kind, DrivenPendulum()),
            brake=Gain(-2.0, output_unit="N*m"),
            shown=Noise([1e-3], EVERY, seed=2),
        )
        diagram.shown >> diagram.filter.measurement
        diagram.filter.of("v", "prediction") >> diagram.brake
        diagram.brake.y >> diagram.filter.command[0]
        diagram.expose(estimate=diagram.filter.estimate, command=diagram.brake.y)
        return diagram

    path = export(controller(), tmp_path / "c.fmu", step=EVERY)
    top = series(c=Fmu(path, step=EVERY))
    ours = simulate(controller(), 4.0, step=EVERY, backend="compiled")
    theirs = simulate(top, 4.0, step=EVERY)
    assert_array_equal(theirs["c.estimate"], ours["filter.estimate"])
    assert_array_equal(theirs["c.command"], ours["brake.y"])
