"""Faults: parameters of the runs, effects on a loop, and isolation of bases."""

import re
from collections import Counter

import numpy as np
import pytest
import xarray as xr
from flight.campaigns import TRUSSES, loop_campaigns
from flight.faults import FEASIBLE, TIMES, Faults, fault_parameters, fault_runs
from flight.loops import flight_hardware, flight_simulator
from flight.metrics import isolation, run_metrics
from numpy.testing import assert_allclose, assert_array_equal

from trussflow.blocks.framework.declarations import Signals
from trussflow.models import Hardware
from trussflow.models.feasibility import shares_left
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.transport import Mission
from trussflow.models.transport.wiring import path_of

PLANT = TunableTruss.consistent()
HARDWARE = Hardware.flight()


def parameters(robot, time=10.0, **fault):
    """Return the parameters of the block faults for a fault of a robot."""
    found = fault_parameters(HARDWARE, PLANT, robot, time, fault)
    return {name.removeprefix("faults."): value for name, value in found.items()}


@pytest.mark.parametrize("case", [1, 2])
def test_each_kind_has_runs_on_all_trusses_and_the_same_parameters(case):
    feasible = FEASIBLE["literal", case]
    kinds, names, rows = zip(*fault_runs(HARDWARE, PLANT, feasible), strict=True)
    assert len({tuple(row) for row in rows}) == 1
    counts = Counter(kinds)
    assert all(count % len(TRUSSES) == 0 for count in counts.values())
    assert counts["base fails"] == 3 * len(feasible)
    assert len(set(names)) == len(names)


def test_each_truss_comes_with_each_time():
    faults = next(
        c for c in loop_campaigns("Literal arm, Case 1", 1) if "faults" in c.name
    )
    for kind in ("base fails", "robot fails, braked", "valve open, 2 N"):
        labels = [label for label in faults.labels if label.startswith(kind)]
        pairs = {re.sub(r".*, (.*)\), (.*)", r"\1 \2", label) for label in labels}
        assert len(pairs) == len(TIMES) * len(TRUSSES)


@pytest.mark.parametrize("arm, case", FEASIBLE)
def test_cases_are_feasible_without_the_bases_that_fail(arm, case):
    plant = HARDWARE.mounted(TunableTruss.accurate(arm=arm))
    path = path_of(Mission.of_case(case), plant)
    limits = flight_hardware(case).limits(plant)
    shares = shares_left(plant.dynamics, path, limits)
    assert tuple(np.flatnonzero(shares == 1.0) + 1) == FEASIBLE[arm, case]


def test_a_fault_concerns_its_robot_only():
    base, robot = parameters(2, base=0.0), parameters(2, base=0.0, drives=0.0)
    assert_array_equal(base["bases"], [1.0, 0.0, 1.0, 1.0])
    assert base["drives"].all()
    assert_array_equal(np.flatnonzero(robot["drives"] == 0.0), np.arange(7, 14))
    assert_array_equal(parameters(3, base=0.5)["bases"], [1.0, 1.0, 0.5, 1.0])
    for time, axis in ((10.0, 2), (30.0, 0), (50.0, 1)):
        forces = parameters(3, time, force=2.0)["forces"]
        assert forces[12 + axis] == -2.0 == forces.sum()
    assert_array_equal(parameters(1, bias=2.0)["bias"], np.repeat([0.0, 2.0], [6, 28]))
    assert_array_equal(np.flatnonzero(parameters(2, encoder=1.0)["stuck"]), [14])
    assert_array_equal(np.flatnonzero(parameters(1, pose=1.0)["stuck"]), np.arange(6))


def test_a_fault_acts_between_its_times_only():
    block = Faults(PLANT, 0.02)
    before = np.arange(34.0)
    older, last, asked = np.zeros(52), np.full(52, 0.5), np.ones(52)
    x = Signals(
        "x",
        {
            "last_position": before,
            "last_rates": -before,
            "last_request": last,
            "older_request": older,
        },
    )
    u = Signals(
        "u",
        {"measured_position": before + 1, "measured_rates": before, "request": asked},
    )
    changes = {"begin": 1.0, "end": 2.0, "bases": np.zeros(4), "invalid": 1, "late": 1}
    stuck = np.zeros(34)
    stuck[6] = 1.0
    p = Signals(
        "p", block.parameters | changes | {"stuck": stuck, "bias": np.full(34, 0.5)}
    )
    during = block.output(1.0, x, u, p)
    assert during["position"][6] == before[6]
    assert during["rates"][6] == -before[6]
    assert_array_equal(np.delete(during["position"] - before, 6), 1.5)
    assert not during["base_effect"].any()
    assert during["valid"] == 0.0
    assert_array_equal(during["command"], older)
    stored = block.update(1.0, x, u, p)
    assert_array_equal(stored["older_request"], x.last_request)
    assert_array_equal(stored["last_request"], u.request)
    for time in (0.99, 2.0):
        found = block.output(time, x, u, p)
        assert_array_equal(found["position"], u.measured_position)
        assert found["base_effect"].all()
        assert found["valid"] == 1.0
        assert_array_equal(found["command"], asked)


@pytest.fixture(scope="module")
def simulator():
    """Return Case 1 with the reference hardware and six modes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TunableTruss, "accurate", TunableTruss.consistent)
        return flight_simulator()


@pytest.fixture(scope="module")
def simulate(simulator):
    """Return a function that simulates with parameters of the block faults."""

    def run(duration, **changes):
        values = {f"faults.{name}": value for name, value in changes.items()}
        values["faults.end"] = duration
        return simulator.run(duration, parameters=values, progress=False)

    return run


def test_a_failed_base_is_isolated(simulate):
    """A base fails under thrust: it is isolated, and the mission continues."""
    found = run_metrics(simulate(2.0, begin=1.0, bases=[0.0, 1.0, 1.0, 1.0]))
    assert found["isolated after"] < 0.7
    assert found["false alarms"] == 0
    assert found["position"] < 0.01
    assert found["attitude"] < 0.01


def test_brakes_hold_the_joints_of_failed_drives(simulate):
    """The first robot fails under thrust; without brakes its arm would move freely."""
    drives = np.append(np.zeros(7), np.ones(21))
    run = simulate(2.0, begin=1.0, bases=[0.0, 1.0, 1.0, 1.0], drives=drives)
    angles = run["truss.task_position"].values[:, 6:13]
    moved = np.abs(angles - angles[run["time"].values == 1.0]).max(axis=1)
    assert moved[run["time"].values > 1.0].max() < 5e-6


def test_a_valve_pushes_and_late_commands_act_two_samples_later(simulate):
    force = np.zeros(PLANT.actuators)
    force[8] = 2.0  # base 2 along z
    healthy, pushed, late = (
        simulate(0.3, **changes)["truss.base_force"].values
        for changes in ({}, {"begin": 0.1, "forces": force}, {"late": 1.0})
    )
    step = np.zeros(healthy.shape[1:])
    step[1, 2] = 2.0
    assert_array_equal(pushed[:5], healthy[:5])  # samples of 20 ms
    assert_allclose(pushed[6] - healthy[6], step, rtol=0.0, atol=1e-12)
    begin, later = (np.flatnonzero(f.any(axis=(1, 2)))[0] for f in (healthy, late))
    assert later == begin + 2


def test_without_a_fault_no_base_is_faulty(simulate):
    found = run_metrics(simulate(0.5))
    assert all(np.ndim(value) == 0 for value in found.values())
    assert np.isnan(found["isolated after"])
    assert found["false alarms"] == 0


@pytest.mark.parametrize("gain", [0.5, 2.0])
def test_a_gain_leaves_the_limits_of_the_bases(simulator, gain):
    """Commands at the limit of the controller give the largest force of the hardware."""
    found = fault_parameters(HARDWARE, PLANT, 1, 0.0, {"gain": gain})
    limits = HARDWARE.limits(PLANT)
    reached = found["controller.allocation.limits"].copy()
    reached[:24] *= gain
    assert_array_equal(reached, limits)
    thrust = gain * found["actuators.thrusters_2.limit.upper"]
    assert_array_equal(thrust, np.full(6, limits[0]))
    plan = simulator.prepared.plan
    assert set(found) <= set(plan.p.named(plan.parameters({})))


def invented(faulty, isolated, valve=False):
    """Return logged signals of 10 s: instants of fault and isolation by base, NaN for none [s]."""
    time = np.linspace(0.0, 10.0, 101)
    on, off = (
        np.stack([time >= np.inf if at is None else time >= at for at in instants], 1)
        for instants in (faulty, isolated)
    )
    columns = np.repeat(np.where(off, 0.0, 1.0), 6, axis=1)
    forces = np.zeros((101, 52))
    forces[:, 2:24:6] = 0.3 * on
    signals = {
        "faults.base_effect": np.where(on, 0.5, 1.0)
        if not valve
        else np.ones(on.shape),
        "faults.valves": forces if valve else 0.0 * forces,
        "controller.monitor.effectiveness": np.append(columns, np.ones((101, 28)), 1),
    }
    return xr.Dataset(
        {k: (("time", f"{k}_0"), v) for k, v in signals.items()}, {"time": time}
    )


@pytest.mark.parametrize("valve", [False, True])
def test_an_isolation_before_the_fault_or_of_another_base_is_a_false_alarm(valve):
    def found(faulty, isolated):
        one = isolation(invented(faulty, isolated, valve))
        return one["false alarms"], one["isolated after"]

    late = [None, 2.0, None, None]
    assert found(late, [None, 2.5, None, None]) == pytest.approx((0, 0.5))
    assert found(late, [None, 1.5, None, None])[0] == 1
    assert found(late, [3.0, None, None, None]) == (1, np.inf)
    assert found([None] * 4, [None] * 4)[0] == 0
    assert found([1.0, 2.0, None, None], [4.0, 3.0, None, None])[1] == pytest.approx(3)
