"""Algebraic loops that are solved inside FMUs and plain C."""

import campaign
import numpy as np
import pytest
from fmpy import read_model_description
from numpy.testing import assert_allclose
from systems import assert_near, series

from trussflow.blocks import (
    Diagram,
    Function,
    Input,
    Integrator,
    Output,
    Ramp,
    Sine,
    ZeroOrderHold,
    simulate,
)
from trussflow.fmu import Fmu, FmuError, export

kinds = pytest.mark.parametrize(
    "version, kind",
    [
        ("2.0", "cs"),
        ("3.0", "me"),
        *(campaign.only(*case) for case in (("2.0", "me"), ("3.0", "cs"))),
    ],
)


def cubic():
    """Return y + y^3 = x + w, dx/dt = w - y."""
    diagram = Diagram("cubic", loops="solve")
    state, bent = diagram.add(
        state=Integrator(2.0),
        bent=Function(
            lambda u, w, back: (u + w - back**3, w - back),
            {"u": Input(), "w": Input(), "back": Input()},
            {"y": Output(), "rate": Output()},
        ),
    )
    state.y >> bent.u
    bent.y >> bent.back
    bent.rate >> state.u
    diagram.expose(w=bent.w, y=bent.y)
    return diagram


def imported(diagram, version, kind, folder, step):
    path = export(diagram, folder / "loop.fmu", version=version, step=step)
    return Fmu(path, kind=kind, step=0.1 if kind == "cs" else None, logging=True)


@kinds
def test_the_same_numbers(version, kind, tmp_path):
    """In steps of RK4, of the FMU or of the importer; the input jumps at samples."""

    def driven(block):
        diagram = Diagram("driven")
        diagram.add(item=block, wave=Sine(1.0, 7.0), hold=ZeroOrderHold(0.1))
        diagram.wave >> diagram.hold >> block.w
        return simulate(diagram, 2.0, step=0.1, log={"y": block.y})["y"].values

    fmu = imported(cubic(), version, kind, tmp_path, 0.1)
    assert_near(driven(fmu), driven(cubic()), 1e-14)


@kinds
def test_a_solution_is_followed(version, kind, tmp_path):
    """The solution of sin(y - 20 t) = 0 that moves, not the one nearest to zero."""
    diagram = Diagram("follower", loops="solve")
    ports = {"back": Input(), "u": Input()}
    ramp, law = diagram.add(
        ramp=Ramp(20.0),
        law=Function(lambda back, u: back - np.sin(back - u), ports, {"y": Output()}),
    )
    ramp.y >> law.u
    law.y >> law.back
    diagram.expose(y=law.y)
    importer = series("importer", fmu=imported(diagram, version, kind, tmp_path, 0.02))
    y = simulate(importer, 1.0, step=0.02 if kind == "me" else 0.1)["fmu.y"].values
    assert_near(y, np.linspace(0.0, 20.0, y.size), 1e-12)


def test_directional_derivatives(version, exported, instance):
    """Derivatives of y by x and w are 1 / (1 + 3 y^2), also at points that no step reached."""
    one = instance(exported(cubic(), version), "me").start({"w": 0.5})
    y = np.roots([1.0, 0.0, 1.0, -2.5])[-1].real
    sizes = () if one.scalar else (1,)
    for known in ("w", "state.integral"):
        places = one.references["y"], one.references[known]
        (found,) = one.getDirectionalDerivative(*places, [1.0], *sizes)
        assert_allclose(found, 1.0 / (1.0 + 3.0 * y * y), rtol=1e-13)


def test_importers_are_asked_to_report_their_steps(exported):
    """The solution of a loop is kept then."""
    first, second = (
        read_model_description(exported(cubic(), v)).modelExchange
        for v in ("2.0", "3.0")
    )
    assert not first.completedIntegratorStepNotNeeded
    assert second.needsCompletedIntegratorStep


def test_a_loop_that_cannot_be_solved_fails_the_step(tmp_path):
    """From 1 s on, y^2 = 1 - t has no solution."""
    roots = Diagram("roots", loops="solve")
    ports = {"u": Input(), "back": Input()}
    ramp, root = roots.add(
        ramp=Ramp(),
        root=Function(lambda u, back: 1.0 - u - back**2 + back, ports, {"y": Output()}),
    )
    ramp.y >> root.u
    root.y >> root.back
    roots.guess(root.y, 1.0)
    roots.expose(y=root.y)
    diagram = series("importer", fmu=imported(roots, "3.0", "cs", tmp_path, 0.01))
    with pytest.raises(FmuError, match="an algebraic loop cannot be solved at time"):
        simulate(diagram, 2.0, step=0.1)
