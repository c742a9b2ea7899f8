"""Faults planted in blocks: each is found, by the check that is for it, and explained."""

import time
from typing import ClassVar

import numpy as np
import pytest

from trussflow.blocks import (
    INFERRED,
    Block,
    Diagram,
    Event,
    Function,
    Input,
    Integrator,
    Mode,
    Output,
    Parameter,
    PythonFunction,
    State,
)
from trussflow.blocks.errors import BlockError
from trussflow.blocks.framework.run_state import Running
from trussflow.blocks.testing import check_block

ANY = "any random point, such as"


class Good(Block):
    """An oscillator without a fault."""

    u = Input(unit="N")
    y = Output(unit="m")
    z = Output((2,), unit="1")
    q = State((2,), unit="m")
    stiffness = Parameter(4.0, unit="N/m", above=0.0)

    def output(self, t, x, u, p):
        return {"y": x.q[0], "z": np.stack([u.u, x.q[1]])}

    def derivative(self, t, x, u, p):
        return {"q": np.stack([x.q[1], u.u - p.stiffness * x.q[0]])}


class ReadsAClock(Good):
    def derivative(self, t, x, u, p):
        return {"q": time.perf_counter() * x.q}


class Counts(Good):
    calls: ClassVar[list[int]] = []

    def output(self, t, x, u, p):
        self.calls.append(1)
        return {"y": x.q[0] * len(self.calls), "z": x.q}


class WritesIntoStates(Good):
    def derivative(self, t, x, u, p):
        x.q[1] *= -1.0
        return {"q": x.q}


class WrongShape(Good):
    def derivative(self, t, x, u, p):
        return {"q": x.q[0]}


class NotANumber(Good):
    def output(self, t, x, u, p):
        return {"y": np.log(-1.0 - u.u**2), "z": x.q}


class Branches(Good):
    def output(self, t, x, u, p):
        return {"y": u.u if u.u > 0.0 else -u.u, "z": x.q}


class NoSampleTime(Block):
    y = Output()
    z = State()

    def output(self, t, x, u, p):
        return {"y": x.z}

    def update(self, t, x, u, p):
        return {"z": x.z + 1.0}


class NoEvent(Good):
    def on_event(self, t, x, u, p, fired):
        return {"q": -x.q}


class BadEvent(Good):
    hit = Event("falling")
    stuck = Mode()

    def indicators(self, t, x, u, p):
        return {"hit": x.q[0]}

    def on_event(self, t, x, u, p, fired):
        return {"stuck": x.q}


class Unanswered(Good):
    hit = Event("falling")

    def indicators(self, t, x, u, p):
        return {"hit": x.q[0]}


class Answered(Unanswered):
    def on_event(self, t, x, u, p, fired):
        return {"q": -x.q}


class InPython(Block):
    """A Python block without a fault."""

    traced = False
    u = Input()
    v = Input()
    y = Output()

    def output(self, t, x, u, p):
        return {"y": u.u**2}

    def feedthrough(self):
        return {"y": ("u",)}


class Undeclared(InPython):
    def output(self, t, x, u, p):
        return {"y": u.u * u.v}


class NeverUsed(InPython):
    def feedthrough(self):
        return {"y": ("u", "v")}


class WrongSlope(InPython):
    def directional_derivative(self, kind, t, x, u, p, dx, du):
        return {"y": 3.0 * u.u * du.u}


class RightSlope(InPython):
    def directional_derivative(self, kind, t, x, u, p, dx, du):
        return {"y": 2.0 * u.u * du.u}


class SlopeOfNothing(InPython):
    def directional_derivative(self, kind, t, x, u, p, dx, du):
        return {}


class FeedthroughRaises(InPython):
    def feedthrough(self):
        raise KeyError("q")


class InitialRaises(Good):
    def initial(self, name, p):
        raise ValueError("ini")


class WrongSlopeBesideALargeOne(InPython):
    z = Output()

    def output(self, t, x, u, p):
        return {"y": 1e6 * u.u, "z": 5.0 * u.u}

    def feedthrough(self):
        return {"y": ("u",), "z": ("u",)}

    def directional_derivative(self, kind, t, x, u, p, dx, du):
        return {"y": 1e6 * du.u, "z": 0.0 * du.u}


class Keeps(Running):
    def __init__(self):
        self.sum = 0.0

    def output(self, t, x, u, p):
        self.sum += float(u.u)
        return {"y": np.array(self.sum)}


class ChangesInOutput(InPython):
    def open(self, p):
        return Keeps()


SHARED = Keeps()


class OpensTheSame(InPython):
    def open(self, p):
        return SHARED


FAULTS = (
    (ReadsAClock, "purity", r"derivative\(\): 'q' is .* reads a clock"),
    (
        Counts,
        "purity",
        r"output\(\): 'y' is .*, then .* for the same arguments: .* keeps something between calls\. Declare "
        "kept values as a State",
    ),
    (
        WritesIntoStates,
        "numbers",
        r"derivative\(\) of .* read-only: an equation writes into an argument, .*; return a new array",
    ),
    (
        WrongShape,
        "numbers",
        r"'q' is declared with shape \(2,\), but was returned with shape \(\)",
    ),
    (
        NotANumber,
        "numbers",
        rf"output\(\): 'y' is not finite at {ANY} nan; look for .* logarithm of a neg",
    ),
    (Branches, "tracing", r"cannot be traced: .*np\.where"),
    (NoSampleTime, "declarations", r"discrete states need a sample time"),
    (NoEvent, "declarations", r"event methods would never be called"),
    (
        BadEvent,
        "numbers",
        r"on_event\(\) .*'stuck' is declared with shape \(\), but was returned with shape \(2,\)",
    ),
    (Undeclared, "feedthrough", r"'y' depends on v, .*return \{'y': \('u', 'v'\)\}"),
    (
        NeverUsed,
        "feedthrough",
        r"feedthrough: y depends on u, v; the values show less\. Let .* return \{'y': \('u',\)\}: unn",
    ),
    (
        WrongSlope,
        "derivatives",
        r"derivative of 'y' by u\.u is .*, by differences .*directional_derivative",
    ),
    (
        WrongSlopeBesideALargeOne,
        "derivatives",
        r"derivative of 'z' by u\.u is 0\.0, by differences 5",
    ),
    (
        SlopeOfNothing,
        "derivatives",
        r"directional_derivative\(\) of .* raised KeyError at t = .*: 'y'",
    ),
    (
        FeedthroughRaises,
        "feedthrough",
        r"feedthrough\(\) of block 'FeedthroughRaises' raised KeyError: 'q'",
    ),
    (
        InitialRaises,
        "declarations",
        r"initial\(\) of block 'InitialRaises' raised ValueError: ini",
    ),
    (ChangesInOutput, "purity", r"output\(\): 'y' is .* keeps something between calls"),
    (OpensTheSame, "purity", r"it was opened before; each run needs a new one"),
)


@pytest.mark.parametrize(
    "block, check, message", FAULTS, ids=[fault[0].__name__ for fault in FAULTS]
)
def test_planted_faults_are_found_by_name(block, check, message):
    report = check_block(block())
    assert check in report.failures, report
    found = report.findings[check]
    assert found.startswith("FAILED: ")
    with pytest.raises(BlockError, match=message):
        raise BlockError(found)
    if check not in ("purity", "tracing"):  # what is impure does not trace either
        assert [*report.failures] == [check], report
    with pytest.raises(
        BlockError, match=rf"{block.__name__}\): \d of \d checks failed"
    ):
        report.raise_for_failures()


@pytest.mark.parametrize("block", [Good, InPython, RightSlope])
def test_good_blocks_pass(block):
    item = block()
    report = check_block(item)
    report.raise_for_failures()
    assert set(report.findings) == {
        *(
            "declarations",
            "numbers",
            "purity",
            "tracing",
            "feedthrough",
            "derivatives",
            "units",
        )
    }
    assert repr(report).startswith(
        f"{block.__name__} ({block.__name__}): all is well\n  declarations  passed\n"
    )


def test_events_without_effect_are_mentioned():
    report = check_block(Unanswered())
    report.raise_for_failures()
    assert report.findings["declarations"].startswith("passed: no on_event(): ")
    assert check_block(Answered()).findings["declarations"] == "passed"


def test_what_does_not_apply_says_why():
    report = check_block(
        PythonFunction(lambda u: u, inputs={"u": Input()}, outputs={"y": Output()})
    )
    report.raise_for_failures()
    assert (
        report.findings["tracing"]
        == "not applicable: the block declares traced = False, and runs in Python"
    )
    assert "no unit is declared for u, y" in report.findings["units"]
    assert "it does not trace" in check_block(Branches()).findings["feedthrough"]


def test_shapes_that_wires_decide_stay_open():
    class Twice(Block):
        u = Input(INFERRED, unit=INFERRED)
        y = Output(INFERRED, unit=INFERRED)

        def output(self, t, x, u, p):
            return {"y": 2.0 * u.u}

    diagram, twice = Diagram("d"), Twice()
    check_block(twice).raise_for_failures()
    integral = diagram.add(integral=Integrator([0.0, 0.0]))
    diagram.add(twice=twice)
    integral >> twice >> integral
    assert twice.y.shape == (2,)
    check_block(twice).raise_for_failures()


def test_numbers_that_make_sense_together_may_be_said():
    block = Function(lambda u: np.sqrt(-5.0 - u), {"u": Input()}, {"y": Output()})
    assert "around=" in check_block(block).failures["numbers"]
    report = check_block(block, around={"u": -7.0})
    assert report.findings["numbers"] == "passed"
    assert (
        "no state or input 'w'; there are: u"
        in check_block(block, around={"w": 1.0}).failures["declarations"]
    )


@pytest.mark.parametrize("item", [Good, None, Diagram("d"), 5.0])
def test_what_is_no_block_is_refused(item):
    with pytest.raises(
        BlockError, match=r"cannot check .*: give one block, such as MyBlock\(\)"
    ):
        check_block(item)
