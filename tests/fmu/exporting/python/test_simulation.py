"""A pythonfmu FMU is valid, and runs as the diagram runs here."""

import numpy as np
import pytest
from fmpy.validation import validate_fmu
from numpy.testing import assert_allclose
from systems import PythonBall, assert_near, series

from trussflow.blocks import Session, Step, TransferFunction
from trussflow.fmu.exporting.export import export as fmu_export

AGREEMENT_TOLERANCE = (
    1e-10  # of the requirement; the same code runs in both, so it is equal to the bit
)
COMMUNICATION_STEP = 0.01


def test_validator_reports_nothing(loop_fmu):
    assert validate_fmu(str(loop_fmu)) == []


def test_stepped_fmu_equals_the_diagram_in_this_process(loop_fmu, instance, make_loop):
    one = instance(loop_fmu).start()
    loop = make_loop(python="sum[1]" in one.references)
    found, expected = [], []
    with Session(loop, step=1e-3) as session:
        session.start(parameters={"plant.stiffness": 7.0})
        for k in range(30):
            goal = [np.sin(k), 0.5]
            one.set({"goal": goal})
            one.doStep(k * COMMUNICATION_STEP, COMMUNICATION_STEP)
            session.set(goal=goal)
            session.advance((k + 1) * COMMUNICATION_STEP)
            found.append(one.get(*session.outputs))
            expected.append(
                np.concatenate([v.ravel() for v in session.outputs.values()])
            )
    assert np.ptp(expected, axis=0).min() > 1e-3
    assert_near(found, expected, AGREEMENT_TOLERANCE)
    assert one.errors == ""


def test_both_kinds_of_fmu_give_the_same(make_loop, tmp_path, instance):
    """They have the same variables, and agree to round-off, off the grid as well."""
    ends = []
    for kind in ("native", "python"):
        fmu = fmu_export(
            make_loop(python=False), tmp_path / f"{kind}.fmu", kind=kind, step=0.005
        )
        one = instance(fmu).start({"goal[1]": 0.3, "plant.v[2]": 0.5}, begin=0.2)
        rows = [one.get()]
        for k in range(12):
            one.set({"goal[2]": np.sin(k)})
            one.doStep(0.2 + 0.017 * k, 0.017)
            rows.append(one.get())
        ends.append((list(one.references), rows))
    assert ends[0][0] == ends[1][0]
    assert_near(ends[1][1], ends[0][1], AGREEMENT_TOLERANCE)


def test_outputs_follow_inputs_and_tuned_parameters_at_once(loop_fmu, instance):
    """Torque = gain (goal - angle) while the law's clock ticks; a tuned gain counts from now.

    After the end values can still be read.
    """
    one = instance(loop_fmu).start()
    one.step(0, 2, COMMUNICATION_STEP)
    angle, total = one.get("angle[1]"), one.get("torque[1]") + 2 * one.get("angle[1]")
    for gain, goal in ((2.0, 1.0), (3.0, 1.0), (3.0, -2.0)):
        one.set({"law.gain": gain, "goal[1]": goal})
        assert_allclose(one.get("torque[1]"), gain * (goal - angle) + total, rtol=1e-12)
    one.doStep(2 * COMMUNICATION_STEP, COMMUNICATION_STEP)
    one.terminate()
    assert one.get("time") == 3 * COMMUNICATION_STEP
    assert one.errors == ""


def test_start_time_is_the_time_of_the_equations(export, instance):
    """A step at 0.3 s comes at 0.3 s, whenever the run began; an adaptive solver may step anywhere."""
    diagram = series(step=Step(0.3), lag=TransferFunction([1.0], [1.0, 1.0]))
    diagram.expose(y=diagram.lag.y)
    fmu = export(diagram, solver="DOP853")
    for begin in (0.0, 0.25):
        one = instance(fmu).start(begin=begin)
        time = begin
        for length in (0.1234567, np.pi / 7, 1 / 3):
            one.doStep(time, length)
            time += length
        assert_allclose(one.get("y"), 1.0 - np.exp(-(time - 0.3)), rtol=1e-7)
        assert one.get("time") == pytest.approx(time, rel=1e-14)


def test_python_block_with_events_is_an_fmu_too(export, instance):
    """z(t) = 1 - 5 t^2 until the first bounce at sqrt(0.2) s, which halves the speed."""
    fmu = export(PythonBall(), step=0.04)
    one = instance(fmu).start()
    one.step(0, 6, 0.1)
    assert one.errors == ""
    time, speed = 0.6 - np.sqrt(0.2), np.sqrt(5.0)
    exact = [speed * time - 5 * time**2, speed - 10 * time]
    assert_near(one.get("height", "speed"), exact, 1e-9)
