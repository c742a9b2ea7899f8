"""Exact derivatives of runs: against closed forms, and differences of runs."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from systems import Level, differences, ports, ring, series

from trussflow.blocks import (
    Constant,
    Diagram,
    Gain,
    Integrator,
    Parameter,
    PythonFunction,
    Sine,
    StateSpace,
    TransportDelay,
    UnitDelay,
    ZeroOrderHold,
    gradient,
)
from trussflow.blocks.errors import (
    DivergenceError,
    NameLookupError,
    SimulationError,
    TracingError,
)
from trussflow.blocks.simulation.solver import FIXED_STEP


def decay(gain=-2.0, start=3.0):
    return ring(law=Gain(gain), level=Integrator(start))


def end(run):
    return run["level.y"][-1]


def growth(z):
    """Return what a step of RK4 multiplies the state with."""
    return 1.0 + z + z**2 / 2.0 + z**3 / 6.0 + z**4 / 24.0


def test_a_decay_has_the_derivatives_of_its_steps():
    value, by = gradient(
        decay(), 1.0, end, {"law.gain": -2.0, "level.integral": 3.0}, step=0.1
    )
    whole = growth(-0.2) ** 10
    slope = 1.0 - 0.2 + 0.2**2 / 2.0 - 0.2**3 / 6.0
    assert value == pytest.approx(3.0 * whole, rel=1e-13)
    assert by["level.integral"] == pytest.approx(whole, rel=1e-13)
    assert by["law.gain"] == pytest.approx(
        3.0 * 10.0 * whole / growth(-0.2) * slope * 0.1, rel=1e-13
    )


def test_where_a_parameter_is_the_initial_state_both_count():
    _, by = gradient(decay(), 1.0, end, {"level.initial_value": 3.0}, step=0.1)
    assert by["level.initial_value"] == pytest.approx(growth(-0.2) ** 10, rel=1e-9)


def test_derivatives_of_arrays_by_arrays():
    gains = -np.arange(1.0, 4.0)
    value, by = gradient(
        decay(gains, np.ones(3)),
        1.0,
        lambda run: run["level.y"][-1],
        {"law.gain": gains},
        step=0.01,
    )
    assert by["law.gain"].shape == (3, 3)
    assert_allclose(value, np.exp(gains), rtol=1e-7)
    assert_allclose(by["law.gain"], np.diag(np.exp(gains)), rtol=1e-7, atol=1e-15)


def sampled(periods):
    """Return a plant under a law that is held, late, and behind filters of these periods."""
    diagram = Diagram("sampled")
    plant, late, law, wave = diagram.add(
        plant=StateSpace(
            [[0.0, 1.0], [-4.0, -0.2]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]]
        ),
        late=UnitDelay(0.05, offset=0.01, shape=1),
        law=Gain(-1.5, shape=1),
        wave=Sine(np.array([0.5]), 3.0),
    )
    last = plant >> late
    for i, period in enumerate(periods):
        last = last >> diagram.add(f"hold{i}", ZeroOrderHold(period, shape=1))
    (last >> law).y + wave.y >> plant.u
    return diagram


def spent(run):
    return (
        np.mean(run["plant.y"] ** 2)
        + 0.1 * np.max(np.abs(run["law.y"]))
        + run["plant.y"][-1, 0]
    )


@pytest.mark.parametrize("solver", FIXED_STEP)
@pytest.mark.parametrize("periods", [(0.02,), (0.02, 0.04, 0.06)], ids=len)
def test_gradients_agree_with_differences(periods, solver):
    at = {
        "law.gain": -1.5,
        "wave.amplitude": np.array([0.5]),
        "late.previous": np.array([0.3]),
    }
    settings = {"step": 0.01, "log_step": 0.07, "solver": solver}
    case = sampled(periods), 3.0, spent, at
    value, by = gradient(*case, **settings)
    expected, slopes = differences(*case, 1e-5, **settings)
    assert value == pytest.approx(expected, rel=1e-13)
    for name, slope in slopes.items():
        assert by[name] == pytest.approx(slope, rel=1e-6), name


class Curved(Level):
    """An integrator whose initial state is the square of a parameter."""

    start = Parameter(2.0)

    def initial_state(self, u, p):
        return {"x": p.start**2}


def test_curved_initial_states_are_refused():
    diagram = series("curved", one=Constant(1.0), curved=Curved())
    with pytest.raises(SimulationError, match=r"no affine function of 'curved\.start'"):
        gradient(
            diagram,
            1.0,
            lambda run: run["curved.y"][-1],
            {"curved.start": 2.0},
            step=0.1,
        )


def untraced():
    diagram = decay()
    diagram.level >> diagram.add(
        "own", PythonFunction(lambda u: u, 0.1, **ports(u=(), y=()))
    )
    return diagram


def delayed():
    diagram = decay()
    diagram.level >> diagram.add("late", TransportDelay(1.0))
    return diagram


@pytest.mark.parametrize(
    "build, function, at, settings, error, match",
    [
        (untraced, end, {"law.gain": 1.0}, {}, SimulationError, "Python blocks"),
        (delayed, end, {"law.gain": 1.0}, {}, SimulationError, "transport delays"),
        (
            decay,
            end,
            {"law.gain": 1.0},
            {"solver": "RK45"},
            SimulationError,
            "adaptive solver 'RK45'",
        ),
        (decay, end, {}, {}, SimulationError, "nothing varies"),
        (decay, end, {"law.gian": 1.0}, {}, NameLookupError, r"law\.gain"),
        (decay, end, {"law.gain": "x"}, {}, Exception, "numeric"),
        (
            decay,
            lambda run: float(end(run)),
            {"law.gain": 1.0},
            {},
            TracingError,
            "cannot diff",
        ),
        (
            decay,
            lambda run: run["level.z"],
            {"law.gain": 1.0},
            {},
            NameLookupError,
            r"'level\.z' is logged; there are: time, law\.y, level\.y$",
        ),
        (
            decay,
            end,
            {"law.gain": 1e5},
            {},
            DivergenceError,
            "not finite with law.gain = 1",
        ),
    ],
)
def test_what_cannot_be_differentiated_is_refused(
    build, function, at, settings, error, match
):
    with pytest.raises(error, match=match):
        gradient(build(), 10.0, function, at, **settings or {"step": 0.1})
