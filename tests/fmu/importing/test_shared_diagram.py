"""One diagram with FMUs of both kinds and a Python block, run many times at once."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import HiddenSum

from trussflow.blocks import Diagram, Session, Simulator, cosimulate
from trussflow.fmu import Fmu

TIME_STEP = 0.05


@pytest.fixture
def diagram(make_fmu):
    found = Diagram("shared")
    found.add(
        stepping=Fmu(
            make_fmu("ball"), kind="cs", step=TIME_STEP, parameters={"e": 0.6}
        ),
        exchanging=Fmu(make_fmu("ball", 3), kind="me"),
        total=HiddenSum().sampled(TIME_STEP),
    )
    (found.stepping.h + found.exchanging.h) >> found.total.u[0]
    return found


PORTS = ["stepping.h", "exchanging.h", "total.y"]


def advanced(session, until):
    session.advance(until)
    return [session.outputs[name].item() for name in PORTS]


def values(result):
    return np.column_stack([result[name] for name in PORTS])


def test_every_run_of_it_is_equal_to_a_run_alone(diagram):
    points = TIME_STEP * np.arange(1, 21)
    with Session(diagram, step=TIME_STEP, outputs=PORTS) as session:
        alone = [advanced(session, float(t)) for t in points]
    assert np.ptp(alone, axis=0).min() > 0.5
    simulator = Simulator(diagram, step=TIME_STEP, log=PORTS)
    whole = values(simulator.run(1.0))
    coupled = values(cosimulate(diagram, 1.0, step=TIME_STEP, log=PORTS))

    one = Session(diagram, step=TIME_STEP, outputs=PORTS)
    other = one.twin()
    with one, other, ThreadPoolExecutor(3) as pool:
        interleaved = []
        for number, t in enumerate(points):
            pair = [advanced(session, float(t)) for session in (one, other)]
            interleaved.append(pair)
            if number == 9:  # in the middle of both sessions
                runs = [pool.submit(simulator.run, 1.0) for _ in range(3)]
                beside = cosimulate(diagram, 1.0, step=TIME_STEP, log=PORTS)
                for run in runs:
                    assert_array_equal(values(run.result()), whole)
                assert_array_equal(values(beside), coupled)
    assert_array_equal(np.array(interleaved)[:, 0], alone)
    assert_array_equal(np.array(interleaved)[:, 1], alone)
