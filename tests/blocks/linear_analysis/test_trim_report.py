"""The report of a trimmed point: what an engineer reads of it."""

from dataclasses import replace

import numpy as np
import pytest
from systems import Lag, series

from trussflow.blocks import (
    Diagram,
    DiscreteStateSpace,
    Free,
    Gain,
    TransferFunction,
    trim,
)
from trussflow.blocks.errors import TrimError


class PythonLag(Lag):
    """A lag that is not traced."""

    traced = False

    def feedthrough(self):
        return {"y": ()}


def lines_of(point):
    """Return the lines of a report by the name of the signal."""
    return {line.Index: line for line in point.report.itertuples()}


def best_of(diagram, **conditions):
    """Return the best point of a trim that fails."""
    with pytest.raises(TrimError) as caught:
        trim(diagram, **conditions)
    return caught.value.best


def test_a_report_tells_what_was_found_element_by_element(aircraft):
    at = trim(
        aircraft,
        states={"body.speed": 100.0, "body.height": 1000.0},
        inputs={"thrust": Free(lower=0.0, upper=1e4), "lift": Free()},
        rates={"body.height": 5.0},
    )
    lines = lines_of(at)
    assert list(lines) == [
        "body.speed",
        "body.angle",
        "body.height",
        "thrust",
        "lift",
        "climb",
    ]
    assert [line.role for line in lines.values()] == [
        "fixed",
        "free",
        "fixed",
        "free",
        "free",
        "",
    ]
    assert [line.unit for line in lines.values()] == [
        "m/s",
        "rad",
        "m",
        "N",
        "N",
        "m/s",
    ]
    assert lines["body.height"].rate == pytest.approx(5.0, rel=1e-9)
    # a rate of 5 m/s is what was asked for
    assert abs(lines["body.height"].residual) < 1e-9
    assert lines["climb"].value == pytest.approx(5.0, rel=1e-9)
    assert (lines["thrust"].lower, lines["thrust"].upper) == (0.0, 1e4)
    for name in ("thrust", "lift"):
        assert lines[name].value == at.inputs[name]
    for kind in ("state", "input", "output"):
        assert set(at.report[at.report.kind == kind].index) == {
            name for name, line in lines.items() if f"{kind} {name} " in repr(at)
        }


def test_the_report_of_a_point_that_is_not_met_says_what_is_violated_and_at_a_bound(
    aircraft,
):
    best = best_of(
        aircraft,
        states={"body.speed": 100.0, "body.angle": 0.0},
        inputs={"thrust": Free(100.0, upper=200.0), "lift": Free()},
    )
    lines = lines_of(best)
    assert lines["thrust"].role == "free, at its upper bound"
    drag = 0.05 * 100.0**2 + 1e-6 * best.inputs["lift"] ** 2
    expected = (200.0 - drag) / 1000.0
    assert (
        lines["body.speed"].rate
        == lines["body.speed"].residual
        == pytest.approx(expected, rel=1e-12)
    )
    assert best.residual == best.report.residual.abs().max() > 1e-9


def test_a_rate_that_was_left_alone_is_told_but_never_violated(aircraft):
    fixed = {"body.speed": 100.0, "body.angle": 0.0}
    at = trim(
        aircraft, states=fixed, inputs={"lift": Free()}, rates={"body.speed": None}
    )
    speed = lines_of(at)["body.speed"]
    assert speed.rate < -0.1  # no thrust, so it slows down
    assert np.isnan(speed.residual)
    assert at.residual <= 1e-9


def test_discrete_states_and_wanted_outputs_have_their_residuals_in_the_report():
    diagram = series(
        memory=DiscreteStateSpace([[1.0]], [1.0], [1.0], sample_time=0.1),
        half=Gain(0.5),
    )
    diagram.expose(u=diagram.memory.u, y=diagram.half.y)
    lines = lines_of(trim(diagram, outputs={"y": 2.0}))
    assert lines["memory.x[0]"].kind == "discrete state"
    assert lines["memory.x[0]"].value == pytest.approx(4.0, rel=1e-12)
    assert lines["y"].role == "wanted"
    assert abs(lines["y"].residual) < 1e-9
    # grows by 3 at each instant
    worst = best_of(diagram, inputs={"u": 3.0}, outputs={"y": 2.0})
    assert lines_of(worst)["memory.x[0]"].residual == pytest.approx(3.0, rel=1e-6)


def test_a_point_made_of_a_trimmed_one_has_no_report(aircraft):
    at = trim(
        aircraft,
        states={"body.speed": 100.0},
        inputs={"thrust": Free(), "lift": Free()},
    )
    moved = replace(at, inputs={"thrust": 0.0})
    assert moved.report is None
    *named, value = repr(moved).splitlines()[4].split()
    assert named == ["input", "thrust"]
    assert float(value) == 0.0


def test_what_a_continuous_python_block_gives_out_at_once_is_no_line_of_the_report():
    diagram = Diagram("late")
    first, lag = diagram.add(first=PythonLag(), lag=TransferFunction([1.0], [1.0, 1.0]))
    first >> lag
    diagram.expose(u=first.u, y=lag.y)
    *others, last = lines_of(trim(diagram, inputs={"u": 2.0})).values()
    assert {line.kind for line in others} == {"state", "input"}
    assert last.kind == "output"
    assert last.value == pytest.approx(2.0, rel=1e-9)
