"""One diagram with FMUs of both kinds and a Python block, run many times at once."""

from concurrent.futures import ThreadPoolExecutor
from typing import ClassVar

import numpy as np
import pytest

from trussflow.blocks import Block, Diagram, Input, Output, Running, Session, Simulator, cosimulate
from trussflow.fmu import Fmu

STEP = 0.05


class TotalRun(Running):
    def __init__(self):
        self.total = 0.0

    def output(self, t, x, u, p):
        return {"y": self.total}

    def update(self, t, x, u, p):
        self.total += float(u.first + u.second)
        return {}


class Total(Block):
    """Sums up two heights where nobody sees it."""

    traced: ClassVar[bool] = False
    first = Input(unit="m")
    second = Input(unit="m")
    y = Output()

    def open(self, p):
        return TotalRun()

    def feedthrough(self):
        return {"y": ()}


@pytest.fixture
def diagram(make_fmu):
    found = Diagram("shared")
    found.add(
        stepping=Fmu(make_fmu("ball"), kind="cs", step=STEP, parameters={"e": 0.6}),
        exchanging=Fmu(make_fmu("ball", 3), kind="me"),
        total=Total().sampled(STEP),
    )
    found.stepping.h >> found.total.first
    found.exchanging.h >> found.total.second
    return found


PORTS = ["stepping.h", "exchanging.h", "total.y"]


def advanced(session, until):
    session.advance(until)
    return [float(session.outputs[name]) for name in PORTS]


def values(result):
    return np.stack([result[name].values for name in PORTS])


def test_every_run_of_it_is_equal_to_a_run_alone(diagram):
    points = STEP * np.arange(1, 21)
    with Session(diagram, step=STEP, outputs=PORTS) as session:
        alone = [advanced(session, float(t)) for t in points]
    assert np.ptp(alone, axis=0).min() > 0.5
    simulator = Simulator(diagram, step=STEP, log=PORTS)
    whole = values(simulator.run(1.0, progress=False))
    coupled = values(cosimulate(diagram, 1.0, step=STEP, log=PORTS, progress=False))

    one = Session(diagram, step=STEP, outputs=PORTS)
    other = one.twin()
    with one, other, ThreadPoolExecutor(3) as pool:
        interleaved = []
        for number, t in enumerate(points):
            pair = [advanced(session, float(t)) for session in (one, other)]
            interleaved.append(pair)
            if number == 9:  # in the middle of both sessions
                runs = [pool.submit(simulator.run, 1.0, progress=False) for _ in range(3)]
                beside = cosimulate(diagram, 1.0, step=STEP, log=PORTS, progress=False)
                for run in runs:
                    np.testing.assert_array_equal(values(run.result()), whole)
                np.testing.assert_array_equal(values(beside), coupled)
    np.testing.assert_array_equal(np.array(interleaved)[:, 0], alone)
    np.testing.assert_array_equal(np.array(interleaved)[:, 1], alone)
