"""A random diagram gives the same numbers in every way in which it can run."""

import warnings
from collections import Counter

import campaign
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from random_diagrams import build
from systems import series

from trussflow.blocks import (
    IntegralSlidingMode,
    PythonFunction,
    Ramp,
    Session,
    Simulator,
    Trapezoid,
    cosimulate,
)
from trussflow.blocks.errors import SimulationError, TrussflowError
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.simulation.lanes import Lanes, Points, most_lanes
from trussflow.fmu import Fmu, export

STEP, LENGTH = 0.05, 0.5
ROUND_OFF, ROOT_ROUND_OFF = 1e-9, 1e-5
"""Relative to the largest number of a signal; the larger one where a law has the cube root of an error."""


def exposed(seed):
    """Return the diagram of a seed, with all its outputs exposed."""
    diagram = build(seed)
    ports = [port for block in diagram.blocks.values() for port in block.outputs()]
    diagram.expose(**{f"y{k}": port for k, port in enumerate(ports)})
    return diagram


def around(item):
    """Return a diagram with the item alone, and its outputs by name."""
    diagram = series(item=item)
    return diagram, {port.name: port for port in item.outputs()}


def signals(result):
    """Return the logged outputs as an array of rows."""
    names = sorted((str(name) for name in result if str(name)[0] == "y"), key=len)
    rows = result["time"].size
    return np.column_stack([result[name].values.reshape(rows, -1) for name in names])


def simulated(item, backend="interpreted", **settings):
    diagram, log = around(item)
    simulator = Simulator(diagram, step=STEP, backend=backend, log=log)
    return signals(simulator.run(LENGTH, **settings))


def in_lanes(seed, _folder):
    diagram, log = around(exposed(seed))
    simulator = Simulator(diagram, step=STEP, backend="compiled", log=log)
    if not most_lanes(simulator.prepared):
        raise SimulationError("the diagram does not go in lanes")
    plan, count = simulator.prepared.plan, most_lanes(simulator.prepared)
    p = plan.parameters(None)
    points = Points(*(np.tile(v, (count, 1)) for v in (*plan.initial(p, None), p)))
    (runs,) = Lanes(simulator, count).run(LENGTH, points, "warn")
    first, *others = (signals(runs.dataset(k)) for k in range(count))
    for other in others:
        assert_array_equal(other, first)
    return first


def restored(seed, folder):
    """Run one session to 0.25 s, and another from its saved state."""
    diagram, log = around(exposed(seed))
    one = Session(diagram, outputs=[*log.values()], step=STEP, backend="interpreted")
    other, file, rows = one.twin(), folder / "one.state", []
    with one, other:
        for k in range(11):
            now = one if k < 6 else other
            now.advance(k * STEP)
            rows.append(now.row())
            if k == 5:
                one.save(file)
                other.restore(file)
    return np.array(rows)


def resumed(seed, folder):
    """Stop at 0.3 s by an error of a Python block, and go on from the last checkpoint."""
    stops = [True]

    def stop(time):
        if stops and time > 0.29:
            raise RuntimeError("stopped")
        return time

    diagram = exposed(seed)
    clock, wire = diagram.add(
        clock=Ramp(1.0),
        wire=PythonFunction(stop, STEP, inputs={"u": Input()}, outputs={"y": Output()}),
    )
    clock >> wire
    settings = {"stream_to": folder / "run.nc", "checkpoint_every": 0.1}
    diagram, log = around(diagram)
    simulator = Simulator(diagram, step=STEP, backend="interpreted", log=log)
    with pytest.raises(TrussflowError, match="stopped"):
        simulator.run(LENGTH, **settings)
    stops.clear()
    return signals(simulator.run(LENGTH, resume=True, **settings))


def cosimulated(seed, _folder):
    diagram, log = around(exposed(seed))
    return signals(cosimulate(diagram, LENGTH, step=STEP, members=["item"], log=log))


def imported(kind, version):
    """Return the way through an FMU."""

    def way(seed, folder):
        path = export(
            exposed(seed), folder / f"{version}.fmu", version=version, step=STEP
        )
        return simulated(Fmu(path, kind=kind, step=STEP if kind == "cs" else None))

    return way


WAYS = {
    "interpreted": lambda seed, _folder: simulated(exposed(seed)),
    "compiled": lambda seed, _folder: simulated(exposed(seed), "compiled"),
    "lanes": in_lanes,
    "restored": restored,
    "resumed": resumed,
    "cosimulated": cosimulated,
    "FMI 2, cs": imported("cs", "2.0"),
    "FMI 2, me": imported("me", "2.0"),
    "FMI 3, cs": imported("cs", "3.0"),
    "FMI 3, me": imported("me", "3.0"),
}


def check(seed, folder, counts):
    """Run the diagram of a seed in every way, and return the differences."""
    wrong = []
    try:
        expected = simulated(exposed(seed), "numpy")
    except TrussflowError as error:
        counts["numpy", type(error).__name__] += 1
        return wrong
    if not np.isfinite(expected).all():
        counts["numpy", "not finite"] += 1
        return wrong
    counts["numpy", "ran"] += 1
    blocks = exposed(seed).blocks.values()
    roots = any(isinstance(block, IntegralSlidingMode) for block in blocks)
    # Its accelerations jump within a step, which model exchange divides there.
    jumps = any(isinstance(block, Trapezoid) for block in blocks)
    limit = (ROOT_ROUND_OFF if roots else ROUND_OFF) * np.maximum(
        1.0, np.abs(expected).max(axis=0, initial=0.0)
    )
    for name, way in WAYS.items():
        if jumps and name.endswith("me"):
            continue
        try:
            found = way(seed, folder)
        except TrussflowError as error:
            counts[name, type(error).__name__] += 1
            if "FMI" not in name and name != "lanes":
                wrong.append(f"seed {seed}, {name}: {error}")
            continue
        counts[name, "ran"] += 1
        if found.shape != expected.shape:
            wrong.append(f"seed {seed}, {name}: {found.shape} for {expected.shape}")
        elif not (np.abs(found - expected) <= limit).all():
            error = np.abs(found - expected).max()
            wrong.append(f"seed {seed}, {name}: differs by {error}")
    return wrong


@pytest.mark.parametrize("part", [0, *map(campaign.only, range(1, 5))])
def test_every_way_gives_the_same_numbers(part, tmp_path):
    number = 2 * campaign.SIZE
    counts, wrong = Counter(), []
    first = campaign.SEED + part * number
    for seed in range(first, first + number):
        folder = tmp_path / str(seed)
        folder.mkdir()
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            wrong += check(seed, folder, counts)
    assert not wrong, "\n".join(wrong)
