"""Lifted models of diagrams with sampled blocks, against the simulation of a common period."""

import numpy as np
import pytest
from systems import assert_near, ports

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


STATES = {"plant.x": [0.3, -0.2, 0.5], "outer.x": [0.7], "back.previous": [-0.4]}


def assert_runs_alike(diagram, model, states=STATES):
    """Check the model of a linear diagram by the outputs of a run over some periods."""
    command = np.array([1.0, -0.5])
    x = np.zeros(model.nstates)  # held outputs are zero before the first instant
    for name, values in states.items():
        first = model.state_labels.index(f"{name.replace('.', '/')}[0]")
        x[first : first + len(values)] = values
    with Session(diagram, solver="DOP853", rtol=1e-13, atol=1e-14) as session:
        session.start(initial=states, inputs={"r": command})
        for k in range(1, 9):
            found = np.concatenate([np.ravel(v) for v in session.outputs.values()])
            assert_near(model.C @ x + model.D @ command, found, 1e-8)
            session.advance(k * model.dt)
            x = model.A @ x + model.B @ command


@pytest.mark.parametrize(
    "offsets", [(0.0, 0.0, 0.0), (0.03, 0.1, 0.0), (0.05, 0.0, 0.2), (0.01, 0.02, 0.03)]
)
def test_two_rates_with_offsets_agree_with_a_simulation(offsets):
    diagram = two_rates(offsets)
    model = linearize(diagram)
    assert model.dt == 0.5
    assert model.derivatives == {}
    assert_runs_alike(diagram, model)


@pytest.mark.parametrize(
    "offsets", [(0.0, 0.0, 0.0), (0.03, 0.1, 0.0), (0.05, 0.05, 0.05)]
)
def test_python_blocks_are_differentiated_and_the_model_says_how_well(offsets):
    diagram = two_rates(offsets, python=True)
    model = linearize(diagram)
    assert_runs_alike(diagram, model, STATES | {"inner.z": [0.2, -0.1]})
    assert set(model.derivatives) == {"ahead", "inner"}
    for said in model.derivatives.values():
        assert said.startswith("differences, relative error ")
        assert float(said.rpartition(" ")[2]) < 1e-8


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
