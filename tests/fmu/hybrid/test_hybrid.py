"""Events for every solver, backend and kind of FMU: the table of cases is in ``conftest.py``."""

import subprocess
from pathlib import Path

import campaign
import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu
from fmpy.validation import validate_fmu
from numpy.testing import assert_array_equal
from systems import series

from trussflow.blocks import (
    Free,
    OperatingPoint,
    Session,
    cosimulate,
    linearize,
    simulate,
    trim,
)
from trussflow.blocks.errors import SimulationError
from trussflow.fmu import Fmu, export

REPOSITORY = Path(__file__).parents[3]
TIME_STEP = 0.02


solvers = pytest.mark.parametrize(
    "solver, backend",
    [
        ("rk4", "numpy"),
        ("rk4", "compiled"),
        ("RK45", "compiled"),
        campaign.only("RK45", "numpy"),
    ],
)


@solvers
def test_simulated(case, solver, backend):
    case.run(solver, backend=backend)


@pytest.mark.parametrize("solver", ["euler", "DOP853", "Rodas5P", "auto"])
def test_simulated_by_other_solvers(case, solver):
    if solver == "euler" and not case.straight:
        pytest.skip("Euler's method is inexact on curves")
    case.run(solver)


def exported_case(case, version, exported, solver="rk4"):
    name = f"{case.name} {solver}"
    return exported(case.build(), version, name, step=TIME_STEP, solver=solver)


def check_native(case, path):
    importer = series("co-simulation", fmu=Fmu(path, kind="cs", step=0.1))
    case.run("rk4", importer, step=0.1)
    importer = series(fmu=Fmu(path, kind="me"))
    for solver in ("rk4", "DOP853"):
        case.run(solver, importer)


def test_native_fmus(case, exported):
    """For co-simulation, and for model exchange with a fixed step and with an adaptive one."""
    check_native(case, exported_case(case, "3.0", exported))


def test_native_fmus_with_variable_steps(case, exported):
    check_native(case, exported_case(case, "2.0", exported, solver="auto"))


@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_a_foreign_importer(case, kind, exported):
    """FMPy with CVode finds the zeros by itself."""
    path = str(exported_case(case, "3.0", exported))
    assert validate_fmu(path) == []
    rows = simulate_fmu(
        path,
        stop_time=max(case.exact),
        output_interval=0.1,
        fmi_type=kind,
        relative_tolerance=1e-11,
    )
    # after events
    last = [np.flatnonzero(np.abs(rows["time"] - t) < 1e-9)[-1] for t in case.exact]
    case.check(list(rows["y"][last]), "auto")


def test_python_fmus(case, tmp_path):
    importer = series(
        "importer",
        fmu=Fmu(
            export(case.build(), tmp_path / "case.fmu", kind="python", step=TIME_STEP),
            step=0.1,
        ),
    )
    case.run("rk4", importer, step=0.1)


def test_plain_c(case, tmp_path):
    path = export(case.build(), tmp_path / "case_c.c", kind="c", step=TIME_STEP)
    ticks = ", ".join(str(round(t / TIME_STEP)) for t in case.exact)
    main = tmp_path / "main.c"
    main.write_text(
        f"""#include <stdio.h>
#include "case_c.h"
int main(void) {{
  static case_c m;
  const int at[] = {{{ticks}}};
  case_c_init(&m);
  for (int k = 0, i = 0; i < {len(case.exact)};) {{
    if (k == at[i]) printf("%.17g\\n", case_c_get_y(&m)), ++i;
    else if (case_c_step(&m)) return 1;
    else ++k;
  }}
  return 0;
}}
"""
    )
    program = tmp_path / "program"
    subprocess.run(
        ["cc", "-std=c99", "-O1", "-o", program, main, path, "-lm"], check=True
    )
    printed = subprocess.check_output([program], text=True)
    case.check([float(word) for word in printed.split()])


def test_sessions(case):
    """Advanced in parts that fit no step, and gone back from time to time."""
    found = []
    with Session(case.build(), step=TIME_STEP) as session:
        for t in case.exact:
            snapshot = session.save()
            for _ in range(2):
                session.restore(snapshot)
                session.advance(session.time + 0.37 * (t - session.time))
                session.advance(t)
            found.append(session.outputs["y"])
    case.check(found)


def test_members_of_a_co_simulation(case):
    """Communication is at samples and every 0.1 s, events are anywhere in between."""
    diagram = case.build()
    result = cosimulate(
        diagram,
        max(case.exact),
        step=0.1,
        solver_step=TIME_STEP,
        log={"y": diagram.port("y")},
    )
    case.check(result)


def test_linear_models_keep_modes(cases):
    """A mass that slides answers a force, one whose mode says that it sticks does not; trim moves no mode."""
    slider = type(cases["stick and slip"].build().mass)()
    slides = linearize(slider)
    assert list(slides.state_labels) == ["Slider/q", "Slider/v"]
    assert_array_equal(slides.A, [[0.0, 1.0], [0.0, 0.0]])
    assert_array_equal(slides.B, [[0.0], [1.0]])
    sticks = linearize(slider, at=OperatingPoint(states={"Slider.stuck": 1.0}))
    assert_array_equal(sticks.B, np.zeros((2, 1)))
    states = {"ball.bounces": -1.0, "ball.v": 0.0, "ball.z": Free()}
    point = trim(cases["bouncing ball"].build(), outputs={"y": 2.0}, states=states)
    assert point.states["ball.z"] == pytest.approx(2.0, abs=1e-12)
    assert point.states["ball.bounces"] == -1.0


def test_model_descriptions(cases, version, exported):
    """One indicator; the mode is a discrete variable, which nobody can set."""
    about = read_model_description(
        exported_case(cases["bouncing ball"], version, exported)
    )
    assert (
        about.numberOfEventIndicators
        if version == "2.0"
        else len(about.eventIndicators)
    ) == 1
    mode = next(v for v in about.modelVariables if v.name == "ball.bounces")
    assert (mode.causality, mode.variability, mode.initial) == (
        "local",
        "discrete",
        "calculated",
    )


@pytest.mark.parametrize("early", [False, True])
def test_steps_that_end_at_an_event(cases, early, exported, instance):
    """Early return needs the consent of the importer; the first bounce is at sqrt(0.2) s."""
    one = instance(
        exported_case(cases["bouncing ball"], "3.0", exported), earlyReturnAllowed=early
    ).start()
    _, _, returned, reached = one.doStep(0.0, 0.5)
    assert returned == early
    assert reached == pytest.approx(np.sqrt(0.2) if early else 0.5, abs=1e-12)


@solvers
def test_events_without_end(endless, solver, backend):
    build, t = endless
    with pytest.raises(
        SimulationError, match=rf"events without end at t = {t} s: .* bring it to rest"
    ):
        simulate(build(), 2.0, solver=solver, backend=backend, step=2**-5)


def test_the_page_names_every_case(cases):
    text = (REPOSITORY / "docs" / "hybrid.md").read_text(encoding="utf-8")
    assert [name for name in cases if f"| {name} |" not in text] == []
