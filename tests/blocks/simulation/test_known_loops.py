"""What other simulators were asked for around algebraic loops, with exact answers."""

import numpy as np
import pytest
from systems import assert_near, series

from trussflow.blocks import Diagram, Gain, Integrator, Sine, UnitDelay, simulate

ROUND_OFF = 1e-14


@pytest.mark.parametrize("loops", ["refuse", "solve"])
def test_feedback_of_the_indirect_output_of_a_subsystem_is_no_loop(backend, loops):
    """github.com/petercorke/bdsim/issues/84: one output is direct, the other is fed back; it is exp(-t)."""
    inner = Diagram("inner")
    state, direct = inner.add(state=Integrator(1.0), direct=Gain(2.0))
    inner.expose(u=(state.u, direct.u), passed=direct.y, integral=state.y)
    middle = series(inner=inner)
    middle.expose(u=inner.u, passed=inner.passed, integral=inner.integral)
    diagram = Diagram("outer", loops=loops)
    diagram.add(middle=middle)
    (-1.0 * middle.integral) >> middle.u
    result = simulate(diagram, 1.0, step=0.01, backend=backend)
    exact = np.exp(-result.time)
    assert_near(result["middle.inner.state.y"], exact, 1e-10)
    assert_near(result["middle.inner.direct.y"], -2.0 * exact, 2e-10)


def test_nested_algebraic_subsystems_add_no_delay(backend):
    """github.com/pathsim/pathsim/issues/251: what passes through five of them is of the same instant.

    Each is a loop of its own, y = u + y / 2 = 2 u, and sampled blocks around them see it at once.
    """
    diagram = Diagram("chain")
    signal = diagram.add(wave=Sine(1.0, 3.0 / (2.0 * np.pi))).y
    for k in range(5):
        inner = Diagram(f"inner{k}", loops="solve")
        half, one = inner.add(half=Gain(0.5), one=Gain(1.0))
        total = one.y + half.y
        total >> half
        inner.expose(u=one.u, y=total)
        diagram.add(f"inner{k}", inner)
        signal >> inner.u
        signal = inner.y
    signal >> diagram.add(last=UnitDelay(0.1))
    result = simulate(diagram, 1.0, step=0.1, backend=backend)
    wave = np.sin(3.0 * result.time.values)
    assert_near(result["inner4.sum_1.y"], 32.0 * wave, 1e-12)
    assert_near(result["last.y"][1:], 32.0 * wave[:-1], 1e-12)
