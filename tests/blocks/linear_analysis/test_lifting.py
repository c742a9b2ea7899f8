"""Lifted models of diagrams with sampled blocks, against the simulation of a common period."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import assert_near, ports, ring

from trussflow.blocks import (
    Block,
    Diagram,
    DiscreteStateSpace,
    Function,
    Gain,
    Input,
    Integrator,
    Output,
    Parameter,
    PythonFunction,
    Session,
    State,
    StateSpace,
    UnitDelay,
    ZeroOrderHold,
    linearize,
)
from trussflow.blocks.errors import LinearAnalysisError


class Filter(Block):
    """A first-order lag in plain Python, of two inputs; one of them acts at once."""

    traced = False
    u = Input((2,))
    w = Input()
    y = Output((2,))
    z = State((2,), initial=0.2)
    pole = Parameter(0.6)

    def output(self, t, x, u, p):
        return {"y": x.z + np.array([2.0, -1.0]) * u.w}

    def update(self, t, x, u, p):
        return {"z": p.pole * x.z + u.u[::-1]}

    def feedthrough(self):
        return {"y": ("w",)}


def two_rates(offsets, *, python=False):
    """Return a plant, a filter at 0.1 s that drives it, and a slow outer loop with a delay."""
    diagram = Diagram("two rates")
    plant, outer, mix, back, command = diagram.add(
        plant=StateSpace(
            [[0.0, 1.0, 0.0], [-4.0, -0.4, 1.0], [0.0, 0.0, -2.0]],
            [[0, 0], [1, 0], [0, 1]],
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.5]],
            np.zeros((2, 2)),
        ),
        outer=DiscreteStateSpace(
            [[0.5]], [[1.0]], [[0.7]], [[-0.3]], sample_time=0.25, offset=offsets[1]
        ),
        mix=Gain([0.8, 0.9]),
        back=UnitDelay(0.25, [0.3], offset=offsets[2]),
        command=Function(
            lambda m, b, r: -m + np.stack([b[0], 0.5 * b[0]]) + r,
            **ports(m=2, b=1, r=2, y=2),
        ),
    )
    plant.y[0:1] >> outer >> back
    if python:
        inner = diagram.add(inner=Filter().sampled(0.1, offsets[0]))
        # Computed before `inner`, whose update reads the new value.
        ahead = diagram.add(
            ahead=PythonFunction(
                lambda y: np.array([y[0] + 0.5 * y[1], y[1]]),
                0.1,
                offset=offsets[0],
                **ports(y=2, z=2),
            )
        )
        plant.y >> ahead.y
        ahead.z >> inner.u
        back.y[0] >> inner.w
    else:
        inner = diagram.add(inner=ZeroOrderHold(0.1, offset=offsets[0]))
        plant >> inner
    inner.y >> mix >> command.m
    back.y >> command.b
    command.y >> plant.u
    diagram.expose(r=command.r, y=plant.y, c=command.y, held=inner.y)
    return diagram


def simulated(diagram, period, model):
    """Return A, B, C, D of the map over a period, by starting from unit values."""
    session = Session(diagram, solver="DOP853", rtol=1e-13, atol=1e-14)
    plan = session.prepared.plan
    session.start()
    fresh = session.save()
    size = plan.x.size + plan.u_start
    places = [
        f"{e.path}/{e.name}" + (f"[{i}]" if e.shape else "")
        for layout in (plan.x, plan.memory, plan.held)
        for e in layout
        for i in range(e.stop - e.start)
    ]
    chosen = np.array([places.index(label) for label in model.state_labels])

    def after(z, w):
        full = np.concatenate([z, w])
        session.restore(replace(fresh, x=full[: plan.x.size], d=full[plan.x.size :]))
        y = np.concatenate([np.ravel(v) for v in session.outputs.values()])
        session.advance(period)
        now = session.save()
        return np.concatenate([now.x, now.d])[:size], y

    rest, idle = np.zeros(size), np.zeros(plan.u.size)
    zero = after(rest, idle)
    columns = [after(e, idle) for e in np.eye(size)] + [
        after(rest, e) for e in np.eye(idle.size)
    ]
    step = np.stack([c[0] - zero[0] for c in columns], axis=1)
    seen = np.stack([c[1] - zero[1] for c in columns], axis=1)
    dropped = np.setdiff1d(np.arange(size), chosen)
    assert not step[
        np.ix_(chosen, dropped)
    ].any()  # what is dropped acts on nothing that is kept
    inputs = np.arange(size, size + idle.size)
    return (
        step[np.ix_(chosen, chosen)],
        step[np.ix_(chosen, inputs)],
        seen[:, chosen],
        seen[:, inputs],
    )


@pytest.mark.parametrize(
    "offsets", [(0.0, 0.0, 0.0), (0.03, 0.1, 0.0), (0.05, 0.0, 0.2), (0.01, 0.02, 0.03)]
)
def test_two_rates_with_offsets_agree_with_the_simulation_of_a_period(offsets):
    diagram = two_rates(offsets)
    model = linearize(diagram)
    assert model.dt == 0.5
    assert model.derivatives == {}
    for found, expected in zip(
        (model.A, model.B, model.C, model.D),
        simulated(diagram, 0.5, model),
        strict=True,
    ):
        assert_near(found, expected, 1e-9)


@pytest.mark.parametrize(
    "offsets", [(0.0, 0.0, 0.0), (0.03, 0.1, 0.0), (0.05, 0.05, 0.05)]
)
def test_python_blocks_are_differentiated_and_the_model_says_how_well(offsets):
    diagram = two_rates(offsets, python=True)
    model = linearize(diagram)
    A, B, _, _ = simulated(diagram, 0.5, model)
    assert_near(model.A, A, 1e-9)
    assert_near(model.B, B, 1e-9)
    assert set(model.derivatives) == {"ahead", "inner"}
    for said in model.derivatives.values():
        assert said.startswith("differences, relative error ")
        assert float(said.rpartition(" ")[2]) < 1e-8


def held_oscillator():
    """Return a plant whose position is sampled, scaled and fed back."""
    diagram = ring(
        "held",
        plant=StateSpace([[0.0, 1.0], [-3.0, -0.1]], [[0], [1]], [[1, 0]]),
        hold=ZeroOrderHold(0.2),
        gain=Gain(-0.7),
    )
    diagram.expose(y=diagram.plant.y)
    return diagram


def test_held_outputs_that_are_computed_anew_are_no_states():
    model = linearize(held_oscillator(), "plant.u", "y")
    assert model.state_labels == ["plant/x[0]", "plant/x[1]"]
    assert model.dt == 0.2
    assert model.isdtime()


def test_a_sampled_block_alone_is_its_own_model():
    matrices = [[0.5, 1], [0, 0.2]], [[0], [1]], [[1, 0]], [[2]]
    model = linearize(DiscreteStateSpace(*matrices, sample_time=0.1))
    for found, expected in zip(
        (model.A, model.B, model.C, model.D), matrices, strict=True
    ):
        assert_array_equal(found, expected)
    assert model.state_labels == ["DiscreteStateSpace/x[0]", "DiscreteStateSpace/x[1]"]
    assert model.dt == 0.1


def test_a_nonlinear_law_is_linearized_at_what_it_holds():
    """x+ = x + T sin(3 x), at the sampled x; the point says what is held."""
    diagram = Diagram()
    plant, law = diagram.add(
        plant=Integrator(0.4), law=Function(lambda u: np.sin(3 * u)).sampled(0.5)
    )
    plant >> law >> plant
    model = linearize(diagram, "plant.u", "plant.y")
    assert_near(model.A, [[1 + 0.5 * 3 * np.cos(1.2)]], 1e-14)
    assert model.operating_point.held["law.y"] == pytest.approx(np.sin(1.2))


def test_unused_inputs_and_wires_do_not_spoil_the_model_but_used_ones_are_named():
    diagram = Diagram()
    plant, hold, root = diagram.add(
        plant=Integrator(1.0),
        hold=ZeroOrderHold(0.5),
        root=Function(lambda a, b: a + np.sqrt(b), **ports(a=(), b=(), y=())),
    )
    plant >> hold >> root.a
    root.y >> plant.u
    diagram.expose(b=root.b, y=plant.y)
    assert_near(linearize(diagram, "plant.u").A, [[1.5]], 1e-14)
    with pytest.raises(
        LinearAnalysisError, match=r"no finite derivative by b at this point"
    ):
        linearize(diagram)
    held = Diagram("root of the held signal")
    plant, hold, root = held.add(
        plant=Integrator(), hold=ZeroOrderHold(0.5), root=Function(np.sqrt)
    )
    plant >> hold >> root >> plant
    with pytest.raises(
        LinearAnalysisError, match=r"no finite derivative by hold/y at this point"
    ):
        linearize(held, "plant.u", "plant.y")


def test_sample_times_that_hardly_ever_coincide_are_refused():
    diagram = Diagram()
    diagram.add(a=ZeroOrderHold(0.1), b=ZeroOrderHold(0.1000003))
    diagram.expose(u=(diagram.a.u, diagram.b.u), y=diagram.a.y)
    with pytest.raises(
        LinearAnalysisError, match=r"0.1 s, 0.1000003 s repeat only after 100000 s"
    ):
        linearize(diagram)
