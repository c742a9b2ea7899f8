"""Elements that are computed alike become loops in C: the same numbers, to the last bit, and little code."""

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from systems import series

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    Gain,
    Input,
    Integrator,
    MatrixGain,
    Output,
    Parameter,
    Simulator,
    Sine,
    State,
    StateSpace,
    TransferFunction,
    simulate,
)
from trussflow.blocks.tracing import loop_rerolling
from trussflow.blocks.tracing.codegen import c_sources


class Alike(Block):
    """Elements with equal and with almost equal equations."""

    y, shifted, normed, turned = Output("n"), Output("n"), Output("n"), Output("n")
    x = State("n", initial=0.3)
    k = Parameter(shape=("n",))

    def __init__(self, n):
        self.n = n
        super().__init__(k=np.linspace(1.0, 2.0, n))

    def output(self, t, x, u, p):
        """Return constants that differ, parameters, one value for all, and elements from elsewhere."""
        return {
            "y": np.sin(3.0 * t) * x.x + np.arange(self.n) / 7.0,
            "shifted": np.concatenate([x.x[1:] * p.k[:-1], x.x[:1]]) - x.x**2,
            "normed": (x.x - p.k) / np.sqrt(1.0 + np.sum(x.x**2)) + 2.0 * t,
            "turned": x.x[::-1] * p.k + np.where(np.arange(self.n) == 11, x.x, 1.0),
        }

    def derivative(self, t, x, u, p):
        """Return differences of neighbours."""
        left, right = (
            np.concatenate([x.x[-1:], x.x[:-1]]),
            np.concatenate([x.x[1:], x.x[:1]]),
        )
        return {"x": p.k * (left - 2.0 * x.x + right) + np.cos(t) / (1.0 + x.x**2)}


class Rod(Block):
    """The heat equation, n points between ends of temperature 0."""

    x = State("n", initial="start")
    start = Parameter(shape=("n",))

    def __init__(self, n):
        self.n = n
        super().__init__(start=np.sin(np.pi * np.arange(1, n + 1) / (n + 1)))

    def derivative(self, t, x, u, p):
        """Return second differences."""
        ends = np.zeros(1)
        return {
            "x": np.concatenate([ends, x.x[:-1]])
            - 2.0 * x.x
            + np.concatenate([x.x[1:], ends])
        }


def chain(count):
    """Return many equal blocks of two states, in a row."""
    diagram = Diagram("chain")
    last = diagram.add(source=Sine(1.0, 1.0))
    for k in range(count):
        block = diagram.add(
            f"lag{k}", TransferFunction([1.0, 2.0], [0.1, 0.3 + 0.01 * k, 1.0])
        )
        last >> block
        last = block
    return diagram


def many(n):
    """Return one block of vectors."""
    diagram = series(alike=Alike(n))
    diagram.alike.turned >> diagram.add(gain=Gain(np.linspace(-1.0, 1.0, n)))
    return diagram


def full(n):
    """Return a linear block whose matrix is full."""
    draw = np.random.default_rng(1).standard_normal
    diagram = series(
        "full",
        plant=StateSpace(
            0.1 * draw((n, n)) - 2.0 * np.eye(n), draw((n, 2)), draw((9, n)), 0.0
        ),
    )
    source = diagram.add(source=Sine(np.ones(2), 1.0))
    source >> diagram.plant
    return diagram


def rod(n):
    """Return a rod of n points."""
    return series("rod", rod=Rod(n))


@pytest.mark.parametrize("diagram", [many(40), chain(24), full(40), rod(200)])
def test_loops_give_the_numbers_of_code_written_out(diagram, monkeypatch, tmp_path):
    results = []
    for name, least in (
        ("rolled", loop_rerolling.MIN_LOOP_ELEMENTS),
        ("written out", 10**9),
    ):
        monkeypatch.setenv("TRUSSFLOW_CACHE", str(tmp_path / name))
        monkeypatch.setattr(loop_rerolling, "MIN_LOOP_ELEMENTS", least)
        simulator = Simulator(diagram, step=1e-3, backend="compiled")
        code = "".join(c_sources(simulator.prepared.programs))
        assert bool(re.search(r"i < \d+; \+\+i\) \{", code)) == (name == "rolled")
        results.append(simulator.run(0.02))
    for signal in results[0].data_vars:
        assert_array_equal(results[0][signal], results[1][signal])
    plain = simulate(diagram, 0.02, step=1e-3, backend="numpy")
    for signal in plain.data_vars:
        assert_allclose(results[0][signal], plain[signal], rtol=1e-13, atol=1e-14)


def test_a_long_vector_is_as_much_code_as_a_short_one():
    short, long = (
        sum(
            map(
                len,
                c_sources(
                    Simulator(
                        rod(n), step=1e-3, backend="interpreted"
                    ).prepared.programs
                ),
            )
        )
        for n in (100, 3000)
    )
    assert long < short + 200


def test_a_matrix_is_a_loop_of_tables():
    """A statement for each number would take compilers minutes, and processors longer."""
    simulator = Simulator(full(90), step=1e-3, backend="interpreted")
    code = "".join(c_sources(simulator.prepared.programs[:1]))
    assert code.count("static const double c") >= 90
    assert code.count("fma(") < 4 * 90


class Steps(Block):
    """Values that are made of the one before, each for an output and the next."""

    u, y = Input("m"), Output("m")
    x = State("k")

    def __init__(self, m, steps):
        self.m, self.k, self.steps = m, m * steps, steps
        super().__init__()

    def output(self, t, x, u, p):
        """Return the input."""
        return {"y": u.u}

    def derivative(self, t, x, u, p):
        """Return how far each is from a state."""
        found, value = [], u.u
        for i in range(self.steps):
            value = 0.9 * np.tanh(value) + i
            found.append(value - x.x[i * self.m : (i + 1) * self.m])
        return {"x": np.concatenate(found)}


def test_loops_compute_no_long_value_again_and_again():
    """A matrix product is followed by others, each of which takes the one before twice."""
    diagram = Diagram("steps")
    source, back, product, steps = diagram.add(
        source=Integrator(np.ones(100)),
        back=Gain(-np.ones(100)),
        product=MatrixGain(np.ones((16, 100))),
        steps=Steps(16, 12),
    )
    source >> product >> steps
    source >> back >> source
    code = c_sources(
        Simulator(diagram, step=1e-3, backend="interpreted").prepared.programs
    )[0]
    body = code[code.index("tf_run_derivative") :]
    loops = re.findall(r"i < (\d+); \+\+i\) \{\n(.*?)\n    \}", body, re.DOTALL)
    written, run = (
        body.count("fma("),
        sum((int(n) - 1) * text.count("fma(") for n, text in loops),
    )
    assert written + run < 2 * (16 * 100 + 16 * 12)


def test_what_all_elements_take_is_computed_once():
    diagram = many(300)
    code = "".join(
        c_sources(
            Simulator(diagram, step=1e-3, backend="interpreted").prepared.programs
        )
    )
    assert code.count("= sqrt(") == 1
    assert (
        sum(int(length) for length in re.findall(r"i < (\d+); \+\+i\) \{", code))
        >= 4 * 298
    )


def test_a_constant_of_many_elements_is_built_and_runs():
    diagram = series("many", constant=Constant(np.arange(30_000) / 7.0), gain=Gain(2.0))
    result = simulate(diagram, 0.01, step=1e-2, log=["gain.y"])
    assert_array_equal(result["gain.y"][-1], 2.0 * np.arange(30_000) / 7.0)
