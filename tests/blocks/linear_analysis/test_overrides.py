"""Given systems in the place of blocks and groups: what comes out is what is wired by hand."""

import control
import numpy as np
import pytest
from systems import ports

from trussflow.blocks import (
    Diagram,
    DiscreteStateSpace,
    Function,
    Gain,
    OperatingPoint,
    PythonFunction,
    Quantizer,
    StateSpace,
    Sum,
    TransferFunction,
    linearize,
    linearize_over,
    loop_margins,
    loop_transfer,
    sensitivity,
)
from trussflow.blocks.errors import LinearAnalysisError, NameLookupError

OMEGA = np.geomspace(0.01, 100.0, 60)
ROUND_OFF = 1e-12
IDENTIFIED = control.ss(
    [[-1.0, 3.0], [-3.0, -1.0]], [[1.0], [0.5]], [[2.0, 1.0]], [[0.3]]
)


def assert_same(found, expected):
    """Compare two systems by their frequency responses."""
    omega = OMEGA if found.isctime() else OMEGA[np.pi / found.dt > OMEGA]
    np.testing.assert_allclose(
        found.frequency_response(omega).frdata,
        expected.frequency_response(omega).frdata,
        rtol=ROUND_OFF,
        atol=ROUND_OFF,
    )


def loop():
    """Return a loop with a valve whose slope at zero does not exist, between an actuator and a plant."""
    diagram = Diagram("loop")
    actuator, valve, plant, error = diagram.add(
        actuator=TransferFunction([5.0], [1.0, 5.0]),
        valve=Function(lambda u: np.sign(u) * np.sqrt(np.abs(u))),
        plant=TransferFunction([1.0], [1.0, 0.4, 1.0]),
        error=Sum("+-"),
    )
    error >> actuator >> valve >> plant >> error.u2
    diagram.expose(r=error.u1, y=plant.y)
    return diagram


ACTUATOR = control.ss(control.tf([5.0], [1.0, 5.0]))
PLANT = control.ss(control.tf([1.0], [1.0, 0.4, 1.0]))


@pytest.mark.parametrize(
    ("given", "system"),
    [
        (IDENTIFIED, IDENTIFIED),
        (
            control.tf([1.0, 2.0], [1.0, 3.0, 4.0]),
            control.ss(control.tf([1.0, 2.0], [1.0, 3.0, 4.0])),
        ),
        (0.7, 0.7),
        ([[0.7]], 0.7),
    ],
)
def test_a_loop_is_the_series_connection_with_the_override(given, system):
    L = PLANT * system * ACTUATOR
    override = {"valve": given}
    with pytest.raises(LinearAnalysisError, match="no finite derivative"):
        linearize(loop())
    assert_same(linearize(loop(), override=override), control.feedback(L))
    diagram = loop()
    assert_same(loop_transfer(diagram, "plant.u", override={diagram.valve: given}), L)
    assert_same(
        sensitivity(diagram, "plant.u", override=override), control.feedback(1, L)
    )


def test_margins_are_those_of_the_given_system():
    expected, _, _, _ = control.margin(PLANT * 0.7 * ACTUATOR)
    found = loop_margins(loop(), "plant.u", override={"valve": 0.7}).channels["plant/u"]
    assert found.gain_up == pytest.approx(expected, rel=1e-4)


def test_around_the_block_everything_is_linearized_where_it_was():
    """The block gives out 3 at the point, so the square behind it has the slope 6, whatever stands for it."""
    diagram = Diagram("chain")
    first, block, square = diagram.add(
        first=Gain(1.0),
        block=Function(lambda u: 2.0 + u),
        square=Function(lambda u: u**2),
    )
    first >> block >> square
    diagram.expose(u=first.u, y=square.y)
    at = OperatingPoint(inputs={"u": np.array(1.0)})
    model = linearize(diagram, at=at, override={"block": 10.0})
    assert model.D[0, 0] == pytest.approx(60.0, rel=ROUND_OFF)
    # A sampled one holds what the block gave out.
    sampled = control.ss([[0.0]], [[1.0]], [[10.0]], [[0.0]], dt=0.1)
    found = linearize(diagram, at=at, override={"block": sampled})
    assert found.dt == 0.1
    assert_same(found, 60.0 * control.ss(control.tf([1.0], [1.0, 0.0], 0.1)))


def group(inner=None):
    """Return a plant with a group of two inputs and two outputs in a loop."""
    diagram, sub = Diagram("outer"), Diagram("sub")
    lag, product, gain = sub.add(
        lag=TransferFunction([1.0], [0.5, 1.0]),
        product=Function(lambda a, b: a * b + a, **ports(a=(), b=(), y=())),
        gain=Gain(3.0),
    )
    lag >> product.a
    sub.expose(force=(lag.u, product.b), spare=gain.u, main=product.y, side=gain.y)
    plant, error = diagram.add(
        plant=TransferFunction([2.0], [1.0, 1.0, 3.0]), error=Sum("+--")
    )
    diagram.add(sub=inner or sub)
    error >> diagram.sub.force
    diagram.sub.main >> plant
    plant.y >> error.u2
    diagram.sub.side >> error.u3
    diagram.expose(
        r=error.u1, spare_in=diagram.sub.spare, y=plant.y, side_out=diagram.sub.side
    )
    return diagram


def built(given):
    """Return a group of blocks with these matrices."""
    inner = Diagram("sub")
    system, first, second, third, fourth = inner.add(
        system=StateSpace(given.A, given.B, given.C, given.D),
        first=Gain(1.0),
        second=Gain(1.0),
        third=Gain(1.0),
        fourth=Gain(1.0),
    )
    first.y >> system.u[0]
    second.y >> system.u[1]
    system.y[0] >> third
    system.y[1] >> fourth
    inner.expose(force=first.u, spare=second.u, main=third.y, side=fourth.y)
    return inner


def test_a_group_is_replaced_as_a_whole():
    rng = np.random.default_rng(3)
    A = rng.normal(size=(3, 3)) - 3 * np.eye(3)
    given = control.ss(
        A, rng.normal(size=(3, 2)), rng.normal(size=(2, 3)), np.zeros((2, 2))
    )
    expected = linearize(group(built(given)))
    found = linearize(group(), override={"sub": given})
    assert found.nstates == expected.nstates == 5
    assert_same(found, expected)
    # Ports at the border may be named, whole, and cut.
    for wires in ("sub.force", "sub.main"):
        assert_same(
            loop_transfer(group(), wires, override={"sub": given}),
            loop_transfer(group(built(given)), wires),
        )
    names = ["sub.spare", "plant.u"], ["sub.side", "sub.force"]
    assert_same(
        linearize(group(), *names, cut="sub.side", override={"sub": given}),
        linearize(group(built(given)), *names, cut="sub.side"),
    )


def controlled(law):
    """Return a plant under a law."""
    diagram = Diagram("controlled")
    plant, controller, error = diagram.add(
        plant=TransferFunction([1.0], [1.0, 0.4, 1.0]), controller=law, error=Sum("+-")
    )
    error >> controller >> plant >> error.u2
    diagram.expose(r=error.u1, y=plant.y)
    return diagram


def lag():
    return TransferFunction([1.0], [0.3, 1.0])


def test_sampled_systems_override_continuous_blocks_and_continuous_systems_sampled_blocks():
    discrete = control.ss([[0.5]], [[1.0]], [[0.8]], [[0.2]], dt=0.25)
    law = DiscreteStateSpace([[0.5]], [1.0], [0.8], 0.2, sample_time=0.25)
    found = linearize(controlled(lag()), override={"controller": discrete})
    diagram = controlled(law)
    assert found.dt == 0.25
    assert_same(found, linearize(diagram))
    found = linearize(diagram, override={"controller": control.tf([1.0], [0.3, 1.0])})
    assert found.isctime()
    assert_same(found, linearize(controlled(lag())))


@pytest.mark.parametrize(
    "law",
    [PythonFunction(np.round, 0.1, **ports(u=(), y=())), Quantizer(0.1, 0.1)],
    ids=["python", "quantizer"],
)
def test_blocks_without_derivatives_can_be_overridden(law):
    found = linearize(controlled(law), override={"controller": 2.0})
    assert_same(found, control.feedback(2.0 * PLANT))
    assert found.isctime()


def test_a_family_over_parameters_keeps_the_override():
    diagram = controlled(lag())
    trailer = diagram.add(trailer=Gain(1.0))
    diagram.plant.y >> trailer
    diagram.expose(scaled=trailer.y)
    override = {"controller": 2.0}
    family = linearize_over(
        diagram,
        "r",
        "scaled",
        parameters={"trailer.gain": [1.0, 4.0]},
        times=[0.0, 0.5],
        step=0.01,
        override=override,
    )
    for gain in (1.0, 4.0):
        expected = gain * control.feedback(2.0 * PLANT)
        assert_same(family.sel({"trailer.gain": gain, "time": 0.5}).item(), expected)
    # of a block that is not in the model
    at = OperatingPoint(states={"controller.x": np.array([0.4])})
    assert linearize(diagram, at=at, override=override).nstates == 2


@pytest.mark.parametrize(
    ("override", "error", "message"),
    [
        (
            {"valv": 1.0},
            NameLookupError,
            "no block 'valv' to override; .* actuator, valve, plant, error",
        ),
        ({"": 1.0}, NameLookupError, "no block '' to override"),
        ([("valve", 1.0)], NameLookupError, "must be given by name"),
        (
            {"valve": np.eye(2)},
            LinearAnalysisError,
            r"2 outputs: its ports have 1 elements \(u\)",
        ),
        (
            {"error": 1.0},
            LinearAnalysisError,
            r"its ports have 2 elements \(u1, u2\) and 1 elements \(y\)",
        ),
        (
            {"valve": "1/s"},
            LinearAnalysisError,
            "cannot override 'valve': .* not '1/s'; .*; or a control",
        ),
        (
            {"valve": np.nan},
            LinearAnalysisError,
            "cannot override 'valve': .* is not finite",
        ),
        (
            {"valve": control.frd([1.0], [1.0])},
            LinearAnalysisError,
            "must be numeric, not Frequency",
        ),
        (
            {"valve": Gain(1.0)},
            LinearAnalysisError,
            "cannot override 'valve': .* not Gain",
        ),
        (
            {"valve": control.tf([1.0, 0.0], [1.0])},
            LinearAnalysisError,
            "cannot override 'valve'",
        ),
        (
            {"valve": control.tf([1.0], [1.0, 0.5], True)},
            LinearAnalysisError,
            "sample time is not given",
        ),
    ],
)
def test_what_does_not_fit_is_refused(override, error, message):
    with pytest.raises(error, match=message):
        linearize(loop(), override=override)


def test_what_is_within_a_group_that_is_replaced_cannot_be_named_nor_replaced_again():
    gains = np.eye(2)
    with pytest.raises(
        LinearAnalysisError, match=r"'sub.lag.y' is within what override"
    ):
        linearize(group(), "r", "sub.lag.y", override={"sub": gains})
    with pytest.raises(LinearAnalysisError, match="within another override"):
        linearize(group(), override={"sub": gains, "sub.lag": 1.0})
    other = group()
    with pytest.raises(NameLookupError, match="no block 'sub'"):
        linearize(group(), override={other.sub: gains})
