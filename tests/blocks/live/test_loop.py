"""Poles, frequency response and margins in the browser, against python-control."""

import control
import numpy as np
import pytest
from numpy.testing import assert_allclose
from systems import DrivenPendulum, approach, cubic, ring

from trussflow.blocks import (
    Diagram,
    Function,
    Gain,
    Input,
    Integrator,
    OperatingPoint,
    Output,
    StateSpace,
    TransferFunction,
    ZeroOrderHold,
    loop_margins,
    loop_transfer,
    operating_point_after,
)
from trussflow.blocks.errors import LinearAnalysisError


def resonant():
    """Return a loop whose gain has a limit, with resonances and a right half plane zero."""
    plant = control.tf([1.0], [1.0, 0.2, 4.0]) * control.tf([-0.1, 1.0], [0.5, 1.0])
    plant = control.ss(plant + control.tf([0.3], [1.0, 0.1, 30.0]))
    diagram = Diagram("resonant")
    gain, block = diagram.add(
        gain=Gain(-0.05), plant=StateSpace(plant.A, plant.B, plant.C, plant.D)
    )
    block.y[0] >> gain
    gain.y >> block.u[0]
    return diagram, "gain.u", "gain.gain"


def pendulum():
    """Return a loop that is nonlinear in the state and in the signal of the wire."""
    diagram = Diagram("pendulum")
    gain, cube, plant = diagram.add(
        gain=Gain(-3.0),
        cube=Function(lambda u: u + u**3, {"u": Input()}, {"y": Output(unit="N*m")}),
        plant=DrivenPendulum(),
    )
    diagram.ground(plant.wind)
    plant.measured >> gain >> cube >> plant.drive
    return diagram, "gain.y", "gain.gain"


def balanced():
    """Return a loop with a lower limit of its gain: the plant alone is unstable."""
    diagram = ring(gain=Gain(-3.0), plant=TransferFunction([1.0], [0.01, 0.99, -1.0]))
    return diagram, "gain.y", "gain.gain"


def analysis(window):
    window.wait("trussflowLive.loop && trussflowLive.loop.id === trussflowLive.run.id")
    arrays = ("poles", "omega", "magnitude", "phase")
    found = window.page.evaluate(
        "Object.fromEntries(Object.entries(trussflowLive.loop)"
        ".map(([name, value]) => [name, value?.length ? [...value] : value]))"
    )
    return found | {name: np.array(found[name]) for name in arrays}


def check(found, model):
    closed = model.feedback(1.0).poles()
    poles = found["poles"] @ [1.0, 1.0j]
    scale = abs(closed).max()
    distance = abs(poles[:, None] - closed[None, :]) / scale
    assert max(distance.min(axis=0).max(), distance.min(axis=1).max()) < 1e-9
    response = model(1j * found["omega"])
    gain = 10.0 ** (found["magnitude"] / 20.0)
    own = gain * np.exp(1j * np.radians(found["phase"]))
    assert_allclose(own, response, rtol=1e-9)
    assert found["stable"] == bool((closed.real < 1e-9 * scale).all())


@pytest.mark.parametrize("make", [resonant, pendulum, balanced])
def test_loop_is_that_of_python_control(make, window, tmp_path):
    diagram, port, parameter = make()
    file = diagram.live(
        tmp_path / "page.html", at=port, parameters=[parameter], duration=2.0, step=0.01
    )
    window.open(file)
    value = float(
        diagram.blocks[parameter.split(".")[0]].parameters[parameter.split(".")[1]]
    )
    for factor in (1.0, 1.5):
        if factor != 1.0:
            window.set(parameter, factor * value)
        at = OperatingPoint(parameters={parameter: factor * value})
        model, found = loop_transfer(diagram, port, at=at), analysis(window)
        check(found, model)
        margins = loop_margins(diagram, port, at=at).channels[model.input_labels[0]]
        for name, of in (
            ("up", margins.gain_up),
            ("down", margins.gain_down),
            ("angle", margins.phase),
            ("delay", margins.delay),
        ):
            # python-control interpolates on its own grid.
            assert_allclose(found[name], of, rtol=1e-4, err_msg=name)
    assert not window.complaints


def test_operating_point_at_the_end_of_the_run(window, tmp_path):
    diagram, port, _ = pendulum()
    file = diagram.live(tmp_path / "page.html", at=port, duration=2.0, step=0.01)
    window.open(file)
    window.page.locator("#point").select_option("end")
    window.wait("document.body.dataset.shown > 1")
    at = operating_point_after(diagram, 2.0, step=0.01)
    check(analysis(window), loop_transfer(diagram, port, at=at))


def test_an_unstable_loop_is_named(window, tmp_path):
    diagram, port, parameter = balanced()
    window.open(diagram.live(tmp_path / "page.html", at=port, duration=1.0, step=0.01))
    window.set(parameter, -0.8)
    assert not analysis(window)["stable"]
    window.wait("document.getElementById('margins').textContent.includes('unstable')")


def vector():
    diagram = ring(gain=Gain(-1.0, shape=2), plant=Integrator([1.0, 2.0]))
    return diagram, "gain.y"


@pytest.mark.parametrize(
    "make, message",
    [
        (vector, r"loop at 'gain.y' .*2 elements; name one.*'gain.y\[0\]'"),
        (
            lambda: (ring(hold=ZeroOrderHold(0.05), plant=Integrator()), "plant.u"),
            "sampled blocks; use loop_margins",
        ),
        (lambda: (cubic(), "state.u"), "iterated; use loop_margins"),
        (lambda: (approach(), "goal.y"), "no loop passes through 'goal.y'"),
    ],
)
def test_loops_that_the_page_cannot_analyse_are_refused(make, message, tmp_path):
    diagram, port = make()
    with pytest.raises(LinearAnalysisError, match=message):
        diagram.live(tmp_path / "page.html", at=port, duration=1.0, step=0.01)
    assert not list(tmp_path.iterdir())
