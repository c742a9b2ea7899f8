"""Describing functions, against exact integrals."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from trussflow.blocks import (
    DeadZone,
    Diagram,
    Function,
    Gain,
    IntegralSlidingMode,
    Integrator,
    OperatingPoint,
    Saturation,
    StateSpace,
    linearize,
    loop_transfer,
)
from trussflow.blocks.control.sliding_mode import signed_power
from trussflow.blocks.errors import LinearAnalysisError, NameLookupError

LAW: dict[str, Any] = {
    "gamma": 1.0,
    "mu": 0.25,
    "beta": 0.9,
    "eta": 0.001,
    "sigma": 0.3,
    "boundary_layer": 1e-3,
}


def describing(law, amplitude):
    """Return the describing function of an odd law, by quadrature."""

    def integrand(phase):
        return law(amplitude * np.sin(phase)) * np.sin(phase)

    return 4 / (np.pi * amplitude) * quad(integrand, 0, np.pi / 2, epsabs=0)[0]


def power(exponent):
    """Return the function sgn^b."""
    return lambda u: signed_power(u, np.float64(exponent))


def clipped(u):
    return np.clip(u, -1, 1)


@pytest.mark.parametrize("amplitude", [1e-6, 0.1, 1.5, 30.0])
@pytest.mark.parametrize(
    ("block", "law", "tolerance"),
    [
        (Function(power(0.5)), power(0.5), {"rel": 2e-3}),
        *(
            (Function(power(b)), power(b), {"rel": 2e-4})
            for b in (0.9 / 1.1, 0.9, 1.0, 2.0)
        ),
        (Saturation(-1.0, 1.0), clipped, {"rel": 2e-3}),
        (DeadZone(-1.0, 1.0), lambda u: u - clipped(u), {"abs": 2e-3}),
    ],
)
def test_laws_have_the_gain_of_the_exact_integral(block, law, tolerance, amplitude):
    model = linearize(block, amplitude={"u": amplitude})
    assert model.D[0, 0] == pytest.approx(describing(law, amplitude), **tolerance)


def test_describing_functions_of_smooth_laws_tend_to_the_derivative():
    at = OperatingPoint(inputs={"u": 0.4})
    small = linearize(Function(np.sin), at=at, amplitude={"u": 1e-3}).D[0, 0]
    assert small == pytest.approx(np.cos(0.4), abs=1e-6)
    assert linearize(Function(np.sin), at=at).D[0, 0] == pytest.approx(
        np.cos(0.4), abs=1e-15
    )


def clipped_loop():
    """Return an integrator with a saturated feedback, twice in a row along the wire."""
    diagram = Diagram()
    plant, gain, first, second = diagram.add(
        plant=StateSpace([[-0.5]], [[1.0]], [[1.0]]),
        gain=Gain([-4.0]),
        first=Saturation(-1.0, 1.0, shape=1),
        second=Saturation(-1.0, 1.0, shape=1),
    )
    plant >> gain >> first >> second >> plant
    diagram.expose(y=plant.y)
    return diagram


def test_amplitudes_of_wires_put_the_gain_where_the_wire_ends():
    loop = clipped_loop()
    n = describing(clipped, 3.0)
    m = describing(clipped, 1.7)
    model = loop_transfer(loop, "plant.u", amplitude={"first.u": 3.0})
    assert model(2j) == pytest.approx(4 * n / (0.5 + 2j), rel=2e-3)
    both = loop_transfer(
        loop, "plant.u", amplitude={loop.first.u[0]: 3.0, "second.u": 1.7}
    )
    assert both(2j) == pytest.approx(4 * n * m / (0.5 + 2j), rel=3e-3)
    exact = loop_transfer(loop, "plant.u")
    assert exact(2j) == pytest.approx(4 / (0.5 + 2j), rel=1e-12)
    poles = linearize(loop, "plant.u", "y", amplitude={"first.u": 3.0}).poles()
    np.testing.assert_allclose(poles, [-0.5 - 4 * n], rtol=2e-3)


def test_elements_of_one_wire_may_have_amplitudes_of_their_own():
    loop = Diagram("two channels")
    law, plant = loop.add(law=Function(power(0.9)), plant=Integrator([0.0, 0.0]))
    plant >> law >> plant
    model = linearize(
        loop, plant.u, plant.y, amplitude={"law.u[0]": 1e-3, "law.u[1]": 1e-2}
    )
    gains = [describing(power(0.9), amplitude) for amplitude in (1e-3, 1e-2)]
    np.testing.assert_allclose(model.A, np.diag(gains), rtol=3e-4)


def test_amplitudes_of_states_and_of_single_elements():
    law = IntegralSlidingMode(**LAW, shape=2)
    model = linearize(
        law,
        ["position", "velocity"],
        "acceleration",
        amplitude={"position[1]": 0.1, "velocity": 0.2},
    )
    steep, flat = describing(power(0.9 / 1.1), 0.1), describing(power(0.9), 0.2)
    assert model.B[1, 1] == pytest.approx(0.25 * steep, rel=3e-4)
    assert model.B[0, 0] == 0.25  # no amplitude: the slope of the linear law
    np.testing.assert_allclose(np.diag(model.B[:, 2:]), flat, rtol=3e-4)
    vector = LAW["eta"] * describing(
        lambda s: s / (np.abs(s) + LAW["boundary_layer"]), 0.3
    )
    for name in ("integral", "IntegralSlidingMode.integral[0:2]"):
        one = linearize(law, "position", "acceleration", amplitude={name: 0.3})
        np.testing.assert_allclose(np.diag(one.C), -0.3 - vector, rtol=1e-4)


@pytest.mark.parametrize("amplitude", [0.0, -1.0, np.nan])
def test_bad_amplitudes_are_refused(amplitude):
    with pytest.raises(
        LinearAnalysisError, match=r"amplitude of 'u' = .* must be a positive"
    ):
        linearize(Gain(1.0), amplitude={"u": amplitude})


@pytest.mark.parametrize(
    ("name", "error", "message"),
    [
        (
            "integrl",
            NameLookupError,
            r"has no port 'integrl'; .*; states: IntegralSlidingMode.integral$",
        ),
        (
            "error",
            LinearAnalysisError,
            r"'IntegralSlidingMode.error': name a state, or",
        ),
        (
            "integral[3]",
            NameLookupError,
            r"'integral\[3\]' does not fit the state's shape",
        ),
    ],
)
def test_amplitudes_of_unknown_signals_are_refused(name, error, message):
    with pytest.raises(error, match=message):
        linearize(IntegralSlidingMode(**LAW, shape=1), amplitude={name: 0.1})
