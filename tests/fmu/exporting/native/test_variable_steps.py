"""Native FMUs with variable steps inside co-simulation."""

import numpy as np
import pytest
from systems import Ball, assert_near, ball_height, series, simulate_block

from trussflow.blocks import (
    Block,
    Diagram,
    Integrator,
    Output,
    Sine,
    State,
    Step,
    TransportDelay,
)
from trussflow.blocks.control.bounded_least_squares import bounded_least_squares
from trussflow.fmu import export
from trussflow.fmu.errors import ExportError

EXPLICIT, IMPLICIT = ["RK45", "DOP853"], ["Rodas5P", "auto"]


class Relaxation(Block):
    """Van der Pol's oscillator, stiff: x'' = 1000 (1 - x^2) x' - x."""

    y = Output()
    x, v = State(initial=2.0), State()

    def output(self, t, x, u, p):
        return {"y": x.x}

    def derivative(self, t, x, u, p):
        return {"x": x.v, "v": 1000.0 * (1.0 - x.x**2) * x.v - x.x}


class Pole(Block):
    """x' = x^2, which is 1 / (1 - t)."""

    y = Output()
    x = State(initial=1.0)

    def output(self, t, x, u, p):
        return {"y": x.x}

    def derivative(self, t, x, u, p):
        return {"x": x.x**2}


class Clipped(Pole):
    """x' = -x within limits, by code in C that has no derivative."""

    def derivative(self, t, x, u, p):
        one = np.ones(1)
        found = bounded_least_squares(
            np.eye(1), np.eye(1), np.stack([-x.x]), one, 0.0 * one, -one, one
        )
        return {"x": found[0][0]}


@pytest.mark.parametrize("solver", EXPLICIT + IMPLICIT)
def test_events_are_located(solver, version, exported, instance):
    path = exported(
        Ball(restitution=0.8), version, f"ball {solver}", solver=solver, step=0.1
    )
    one = instance(path).start()
    for k in range(20):
        one.doStep(0.1 * k, 0.1)
        assert_near(one.get("height"), ball_height(0.1 * (k + 1))[0], 1e-9)


@pytest.mark.parametrize("solver", EXPLICIT + IMPLICIT)
def test_events_return_early(solver, exported, instance):
    path = exported(Ball(), "3.0", f"early {solver}", solver=solver, tolerance=1e-10)
    one = instance(path, earlyReturnAllowed=True).start()
    reached = 0.0
    for bounce in (np.sqrt(0.2), 2.0 * np.sqrt(0.2)):
        _, _, early, reached = one.doStep(reached, 1.0 - reached)
        assert early
        assert_near(reached, bounce, 1e-9)


@pytest.mark.parametrize("solver", ["rk4", "DOP853"])
@pytest.mark.parametrize("length", [1e-7, 1e-11])
def test_short_communication_steps_add_up(solver, length, exported, instance):
    """Also those that are shorter than the round-off of times that the importer may have."""
    one = instance(exported(Pole(), "2.0", f"pole {solver}", solver=solver)).start()
    one.step(0, 1000, length)
    assert one.get("y") - 1.0 == pytest.approx(1000 * length, rel=0.02)


@pytest.mark.parametrize("begin", [0.0, -0.3])
def test_jumps_and_samples_end_steps(begin, exported, instance, systems):
    """One communication step: a unit step at 0.55 s, and controllers sampled every 20 and 50 ms."""
    diagram = Diagram("both")
    loop, jump, integral = diagram.add(
        loop=systems.hybrid(), jump=Step(0.55), integral=Integrator()
    )
    jump.y >> integral.u
    diagram.expose(target=loop.target, position=loop.position, y=integral.y)
    settings = {"solver": "DOP853", "step": 0.01, "tolerance": 1e-10}
    one = instance(exported(diagram, "2.0", "jumps", **settings)).start(
        {"target": 0.7}, begin
    )
    one.doStep(begin, 1.234)
    assert_near(one.get("y"), begin + 1.234 - 0.55, 1e-14)
    fine = instance(exported(diagram, "2.0", "fixed steps", step=1e-3))
    fine.start({"target": 0.7}, begin).doStep(begin, 1.234)
    assert_near(one.get("position"), fine.get("position"), 1e-9)


@pytest.mark.parametrize("solver", IMPLICIT)
def test_stiff_equations(solver, exported, instance):
    """The steps are those of a simulation. A saved state repeats them bit by bit, also from before the switch."""
    path = exported(
        Relaxation(), "2.0", f"stiff {solver}", solver=solver, tolerance=1e-8
    )
    one = instance(path).start()
    saved = one.getFMUState()
    one.doStep(0.0, 400.0)
    settings = {"solver": solver, "rtol": 1e-8, "atol": 1e-10}
    expected = simulate_block(Relaxation(), 400.0, {}, **settings)
    assert_near(one.get("y"), expected["block.y"][-1], 1e-14)
    one.doStep(400.0, 500.0)
    after = one.get("x", "v")
    one.setFMUState(saved)
    one.doStep(0.0, 400.0)
    one.doStep(400.0, 500.0)
    assert one.get("x", "v").tolist() == after.tolist()
    one.freeFMUState(saved)
    expected = simulate_block(Relaxation(), 900.0, {}, solver="Rodas5P", rtol=1e-11)
    assert_near(after[:1], expected["block.y"][-1], 1e-6)


def test_the_importer_chooses_the_tolerance(version, exported, instance):
    path = exported(Relaxation(), version, "tolerance", solver="Rodas5P")
    errors = []
    for tolerance in (1e-11, 1e-8, 1e-4):
        one = instance(path)
        chosen = {"tolerance": tolerance, "startTime": 0.0}
        if one.scalar:
            one.setupExperiment(**chosen)
            one.enterInitializationMode()
        else:
            one.enterInitializationMode(**chosen)
        one.exitInitializationMode()
        one.doStep(0.0, 800.0)
        errors.append(one.get("x"))
    coarse, fine = np.abs(errors[2] - errors[0]), np.abs(errors[1] - errors[0])
    assert 100.0 * fine < coarse < 0.1


@pytest.mark.parametrize("tolerance", [0.0, -1.0, np.nan, 1e-30, 1.0])
def test_tolerances_that_no_solver_reaches(
    tolerance, version, exported, instance, tmp_path
):
    """They are refused, except in model exchange, which does not use them."""
    path = exported(Relaxation(), version, "tolerance", solver="Rodas5P")
    for kind in ("cs", "me"):
        one = instance(path, kind)
        begin = one.setupExperiment if one.scalar else one.enterInitializationMode
        if kind == "me":
            begin(tolerance=tolerance, startTime=0.0)
            continue
        with pytest.raises(Exception, match="status"):
            begin(tolerance=tolerance, startTime=0.0)
        assert "is not from 2.2" in one.errors
    with pytest.raises(ExportError, match="tolerance"):
        export(Pole(), tmp_path / "x.fmu", solver="RK45", tolerance=tolerance)


def test_delays_have_room_for_variable_steps(exported, instance):
    """Steps are shorter than the fixed ones."""
    diagram = series(
        source=Sine(1.0, 1.0), late=TransportDelay(1.0), integral=Integrator()
    )
    diagram.expose(y=diagram.integral.y)
    one = instance(exported(diagram, solver="DOP853", step=0.1)).start()
    one.step(0, 100, 0.0201)
    # the integral of the sine from 0 to 1.01 s
    expected = (1.0 - np.cos(2.02 * np.pi)) / (2.0 * np.pi)
    assert_near(one.get("y"), expected, 1e-5)


def test_equations_without_derivatives_are_refused(tmp_path):
    with pytest.raises(ExportError, match="no derivatives; use solver='RK45'"):
        export(Clipped(), tmp_path / "clipped.fmu", solver="auto")


def test_a_step_that_is_too_small_is_discarded(exported, instance):
    one = instance(exported(Pole(), "2.0", "pole", solver="DOP853")).start()
    with pytest.raises(Exception, match="status"):
        one.doStep(0.0, 2.0)
    assert "no step is small enough" in one.log[-1][1]
