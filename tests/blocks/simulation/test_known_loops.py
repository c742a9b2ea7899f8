"""What other simulators were asked for around algebraic loops, with exact answers."""

import numpy as np
import pytest

from trussflow.blocks import Diagram, Function, Gain, Input, Integrator, Output, Sine, UnitDelay, simulate

BACKENDS = ("numpy", "compiled")
ROUND_OFF = 1e-14


@pytest.mark.parametrize("loops", ["refuse", "solve"])
@pytest.mark.parametrize("backend", BACKENDS)
def test_feedback_of_the_indirect_output_of_a_subsystem_is_no_loop(backend, loops):
    """github.com/petercorke/bdsim/issues/84: one output is direct, the other is fed back; it is exp(-t)."""
    inner = Diagram("inner")
    state, direct = inner.add(state=Integrator(1.0), direct=Gain(2.0))
    inner.expose(u=(state.u, direct.u), passed=direct.y, integral=state.y)
    middle = Diagram("middle")
    middle.add(inner=inner)
    middle.expose(u=inner.u, passed=inner.passed, integral=inner.integral)
    diagram = Diagram("outer", loops=loops)
    diagram.add(middle=middle)
    (-1.0 * middle.integral) >> middle.u
    result = simulate(diagram, 1.0, step=0.01, backend=backend)
    exact = np.exp(-result.time)
    np.testing.assert_allclose(result["middle.inner.state.y"], exact, rtol=0, atol=1e-10)
    np.testing.assert_allclose(result["middle.inner.direct.y"], -2.0 * exact, rtol=0, atol=2e-10)


@pytest.mark.parametrize("backend", BACKENDS)
def test_nested_algebraic_subsystems_add_no_delay(backend):
    """github.com/pathsim/pathsim/issues/251: what passes through five of them is of the same instant.

    Each is a loop of its own, y = u + y / 2 = 2 u, and sampled blocks around them see it at once.
    """
    diagram = Diagram("chain")
    source, last = diagram.add(wave=Sine(1.0, 3.0 / (2.0 * np.pi))), diagram.add(last=UnitDelay(0.1))
    signal = source.y
    for k in range(5):
        inner = Diagram(f"inner{k}", loops="solve")
        half, one = inner.add(half=Gain(0.5), one=Gain(1.0))
        total = one.y + half.y
        total >> half
        inner.expose(u=one.u, y=total)
        diagram.add(f"inner{k}", inner)
        signal >> inner.u
        signal = inner.y
    signal >> last.u
    result = simulate(diagram, 1.0, step=0.1, backend=backend)
    wave = np.sin(3.0 * result.time.values)
    np.testing.assert_allclose(result["inner4.sum_1.y"], 32.0 * wave, rtol=0, atol=1e-12)
    np.testing.assert_allclose(result["last.y"][1:], 32.0 * wave[:-1], rtol=0, atol=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("start", "sign"), [(0.0, -1.0), (1.3, 1.0)])
def test_three_equations_over_two_blocks(backend, start, sign):
    """github.com/OpenModelica/OMSimulator/issues/808: a linear block and a quadratic one, two solutions.

    a + b + c = 0 and 2 a - 3 b + 2 c = 9 give a and b of c; a^2 + b^2 + c^2 = 5 gives c of a and b.
    """
    diagram = Diagram("three equations", loops="solve")
    first, second = diagram.add(
        first=Function(lambda c: (1.8 - c, -1.8 + 0.0 * c), {"c": Input()}, {"a": Output(), "b": Output()}),
        second=Function(
            lambda a, b: np.sqrt(5.0 - a * a - b * b), {"a": Input(), "b": Input()}, {"c": Output()}
        ),
    )
    first.a >> second.a
    first.b >> second.b
    second.c >> first.c
    result = simulate(diagram, 0.2, step=0.1, backend=backend, initial={"first.a": start})
    exact = 0.9 + sign * np.sqrt(0.07), -1.8, 0.9 - sign * np.sqrt(0.07)
    found = [result[name].values for name in ("first.a", "first.b", "second.c")]
    np.testing.assert_allclose(np.transpose(found), [exact] * 3, rtol=0, atol=ROUND_OFF)
