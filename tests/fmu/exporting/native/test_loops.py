"""Algebraic loops that are solved inside FMUs and plain C."""

from __future__ import annotations

import numpy as np
import pytest
from fmpy import read_model_description

from trussflow.blocks import Constant, Diagram, Function, Input, Integrator, Output, simulate
from trussflow.fmu import ExportError, Fmu, FmuError, export
from trussflow.fmu.exporting.description.export_interface import ExportInterface


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


@pytest.mark.parametrize("version", ["2.0", "3.0"])
@pytest.mark.parametrize("kind", ["cs", "me"])
def test_the_same_numbers(version, kind, tmp_path):
    """In steps of RK4, of the FMU or of the importer; what comes in jumps at samples."""

    def driven(block):
        diagram = Diagram("driven", loops="solve")
        wave, item = diagram.add(
            wave=Function(lambda t: np.sin(7.0 * t), {"t": Input()}, {"y": Output()}).sampled(0.1), item=block
        )
        clock = diagram.add(clock=Integrator())
        diagram.add(one=Function(lambda u: 1.0 + 0.0 * u, {"u": Input()}, {"y": Output()})).y >> clock.u
        clock.y >> diagram.one.u
        clock.y >> wave.t
        wave.y >> item.w
        return simulate(diagram, 2.0, step=0.1, log={"y": item.y})["y"].values

    path = export(cubic(), tmp_path / "cubic.fmu", version=version, step=0.1)
    fmu = Fmu(path, kind=kind, step=0.1) if kind == "cs" else Fmu(path, kind=kind)
    np.testing.assert_allclose(driven(fmu), driven(cubic()), rtol=0, atol=1e-14)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
@pytest.mark.parametrize("kind", ["cs", "me"])
def test_a_solution_is_followed(version, kind, tmp_path):
    """Of sin(y - 20 t) = 0, the one that moves, not the one nearest to zero."""
    diagram = Diagram("follower", loops="solve")
    ramp, law = diagram.add(
        ramp=Integrator(),
        law=Function(
            lambda back, u: back - np.sin(back - u), {"back": Input(), "u": Input()}, {"y": Output()}
        ),
    )
    diagram.add(rate=Constant(20.0)).y >> ramp.u
    ramp.y >> law.u
    law.y >> law.back
    diagram.expose(y=law.y)
    path = export(diagram, tmp_path / "follower.fmu", version=version, step=0.02)
    importer = Diagram("importer")
    fmu = Fmu(path, kind=kind, step=0.1) if kind == "cs" else Fmu(path, kind=kind)
    importer.add(fmu=fmu)
    y = simulate(importer, 1.0, step=0.02 if kind == "me" else 0.1)["fmu.y"].values
    np.testing.assert_allclose(y, np.linspace(0.0, 20.0, y.size), rtol=0, atol=1e-12)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_directional_derivatives(version, tmp_path, fmi):
    """Of y by x and w: 1 / (1 + 3 y^2), at points that no step led to."""
    path = export(cubic(), tmp_path / "cubic.fmu", version=version)
    variables = {v.name: v.reference for v in ExportInterface.of(cubic()).variables}
    with fmi.opened(path, "me", tmp_path) as fmu:
        fmi.started(fmu, {variables["w"]: np.array([0.5])})
        y = 1.0900536328
        for _ in range(20):
            y -= (y + y**3 - 2.5) / (1.0 + 3.0 * y * y)
        sizes = (1,) if version == "3.0" else ()
        for known in ("w", "state.integral"):
            (found,) = fmu.getDirectionalDerivative([variables["y"]], [variables[known]], [1.0], *sizes)
            np.testing.assert_allclose(found, 1.0 / (1.0 + 3.0 * y * y), rtol=1e-13, atol=0)


def test_importers_are_asked_to_tell_of_their_steps(tmp_path):
    """What a loop was solved by is kept then."""
    first = read_model_description(export(cubic(), tmp_path / "cubic2.fmu", version="2.0"))
    assert not first.modelExchange.completedIntegratorStepNotNeeded
    second = read_model_description(export(cubic(), tmp_path / "cubic3.fmu", version="3.0"))
    assert second.modelExchange.needsCompletedIntegratorStep


def roots():
    """Return y^2 = 1 - x, dx/dt = 1: from 1 s on there is no y."""
    diagram = Diagram("roots", loops="solve")
    state, root = diagram.add(
        state=Integrator(),
        root=Function(
            lambda u, back: 1.0 - u - back**2 + back, {"u": Input(), "back": Input()}, {"y": Output()}
        ),
    )
    one = diagram.add(one=Function(lambda u: 1.0 + 0.0 * u, {"u": Input()}, {"y": Output()}))
    state.y >> root.u
    state.y >> one.u
    one.y >> state.u
    root.y >> root.back
    diagram.guess(root.y, 1.0)
    diagram.expose(y=root.y)
    return diagram


def test_a_loop_that_cannot_be_solved_fails_the_step(tmp_path):
    path = export(roots(), tmp_path / "roots.fmu", version="3.0", step=0.01)
    diagram = Diagram("importer")
    diagram.add(fmu=Fmu(path, kind="cs", step=0.1, logging=True))
    with pytest.raises(FmuError, match="an algebraic loop cannot be solved at time"):
        simulate(diagram, 2.0, step=0.1)


def test_what_has_no_solution_at_the_start_is_not_exported(tmp_path):
    diagram = Diagram("nowhere", loops="solve")
    law = diagram.add(law=Function(lambda y: 1.0 + y + y * y, {"y": Input()}, {"z": Output()}))
    law.z >> law.y
    diagram.expose(z=law.z)
    with pytest.raises(ExportError, match="'z' has no start value"):
        export(diagram, tmp_path / "nowhere.fmu")
