"""Filters in diagrams: every backend gives the same numbers, an FMU the very same."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trussflow.blocks import (
    Block,
    Diagram,
    ExtendedKalmanFilter,
    Gain,
    Input,
    KalmanFilter,
    Noise,
    Output,
    State,
    TimeVaryingKalmanFilter,
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

    def output(self, t: Any, x: Any, u: Any, p: Any) -> Any:
        return {"shadow": np.sin(x.q)}

    def derivative(self, t: Any, x: Any, u: Any, p: Any) -> Any:
        return {"q": x.v, "v": u.torque + u.wind - 9.81 * np.sin(x.q) - 0.1 * x.v}


def designed(kind: str) -> KalmanFilter | TimeVaryingKalmanFilter | ExtendedKalmanFilter:
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


def loop(block: Block, prediction: Any, shape: Any = (1,)) -> Diagram:
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
def test_backends_agree(kind: str) -> None:
    results = [
        simulate(loop(designed(kind), lambda f: f.of("v", "prediction")), 2.0, backend=backend, **SETTINGS)
        for backend in ("numpy", "interpreted", "compiled")
    ]
    for name in ("estimate", "prediction", "innovation"):
        reference, *others = (result[f"filter.{name}"].values for result in results)
        assert np.abs(reference).max() > 1e-3
        for found in others:
            np.testing.assert_allclose(found, reference, rtol=0, atol=1e-11)


@pytest.mark.parametrize("kind", KINDS)
def test_an_estimate_is_what_it_should_be(kind: str) -> None:
    """In the run: the right instants, commands and delays, or these errors would be many times as large."""
    diagram = loop(designed(kind), lambda f: f.of("v", "prediction"))
    result = simulate(diagram, 10.0, **SETTINGS)
    shadow, estimate = result["arm.shadow"].values, result["filter.estimate"].values
    error = (shadow - np.sin(estimate[:, 0]))[100:]
    assert np.std(error) < (3e-3 if kind == "steady" else 2e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_fmu_gives_the_same_numbers_bit_by_bit(kind: str, tmp_path: Path) -> None:
    path = export(designed(kind), tmp_path / "filter.fmu", version="3.0", step=EVERY)
    ours = simulate(loop(designed(kind), lambda f: f.prediction[1]), 2.0, backend="compiled", **SETTINGS)
    theirs = simulate(loop(Fmu(path, step=EVERY), lambda f: f.prediction[1]), 2.0, backend="compiled", **SETTINGS)
    for name in ("estimate", "prediction", "innovation"):
        np.testing.assert_array_equal(theirs[f"filter.{name}"], ours[f"filter.{name}"])
