"""``make bench-peers``: five systems with events in trussflow, PathSim and SciPy by hand, side by side.

Adaptive solvers all have the same tolerances, trussflow's classical Runge-Kutta method a step with which it
is as exact: each result is compared with one of tight tolerances first, and has to be within `ACCURACY`.
SciPy runs by the method that is fastest. What is timed is the run; diagrams are built, and code is compiled,
before.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
import time

import numpy as np
from hybrid_models import ATOL, HYBRIDS, RTOL, by_hand
from pathsim import Simulation
from pathsim.blocks import ODE
from pathsim.events import ZeroCrossingUp
from pathsim.solvers import RKDP54
from table import Row, show

from trussflow.blocks import Simulator

ACCURACY = 1e-5
"""Largest error of the states at the end, relative to the largest of them."""
REPETITIONS, LONG_ENOUGH = 5, 0.1
TARGETS = {"PathSim": 5.0, "SciPy": 3.0}
"""How many times faster ours has to be."""


def ours(case, **settings):
    """Return a run in trussflow."""
    log = list(case.states)
    simulator = Simulator(case.diagram, log=log, log_step=case.duration, **settings)

    def run():
        result = simulator.run(case.duration, progress=False)
        return np.array([result[name].values[-1] for name in log])

    return run


def in_pathsim(case):
    """Return a run in PathSim: one block with the equations, one event."""
    modes = [case.modes]
    ode = ODE(lambda x, u, t: np.array(case.rates(t, x, modes[0])), np.array(case.x))

    def act(t):
        x, modes[0] = case.event(t, ode.engine.get(), modes[0])
        ode.engine.set(np.array(x))

    event = ZeroCrossingUp(
        func_evt=lambda t: case.indicator(t, ode.engine.get(), modes[0]),
        func_act=act,
        tolerance=1e-10,
    )
    simulation = Simulation(
        [ode],
        [],
        [event],
        Solver=RKDP54,
        tolerance_lte_rel=RTOL,
        tolerance_lte_abs=ATOL,
        log=False,
    )

    def run():
        modes[0] = case.modes
        simulation.run(case.duration, reset=True)
        return np.array(ode.engine.get())

    return run


def fastest(case, exact):
    """Return the fastest run with SciPy that is accurate enough, of three methods."""
    runs = [by_hand(case, method) for method in ("RK45", "DOP853", "LSODA")]
    return min((run for run in runs if error(run, exact) <= ACCURACY), key=elapsed)


def error(run, exact):
    """Return the error at the end, relative to the largest state."""
    return float(abs(run() - exact).max() / abs(exact).max())


def elapsed(run):
    """Return the wall time of one run, the mean of as many as take `LONG_ENOUGH` [s]."""
    started, runs = time.perf_counter(), 0
    while (passed := time.perf_counter() - started) < LONG_ENOUGH:
        run()
        runs += 1
    return passed / runs


def main():
    """Print the table; fail if results disagree or a ratio is below its target."""
    rows, failed = [], []
    for name, case in HYBRIDS.items():
        exact = by_hand(case, "DOP853", 1e-12, 1e-12)()
        runs = {
            "trussflow": ours(case, step=case.step),
            "its RK45": ours(case, solver="RK45", rtol=RTOL, atol=ATOL),
            "PathSim": in_pathsim(case),
            "SciPy": fastest(case, exact),
        }
        errors = {who: error(run, exact) for who, run in runs.items()}
        rows.append(
            Row(
                f"{name}: errors",
                ", ".join(f"{who} {e:.0e}" for who, e in errors.items()),
            )
        )
        failed += [
            f"{name}: {who} is wrong by {e:.1e}"
            for who, e in errors.items()
            if not e <= ACCURACY
        ]
        times = np.array(
            [[elapsed(run) for run in runs.values()] for _ in range(REPETITIONS)]
        )
        medians = dict(zip(runs, np.median(times, axis=0), strict=True))
        rows.append(
            Row(
                f"{name}: times",
                ", ".join(f"{who} {1e3 * t:.3g} ms" for who, t in medians.items()),
            )
        )
        for who, target in TARGETS.items():
            ratio = float(np.median(times[:, list(runs).index(who)] / times[:, 0]))
            rows.append(
                Row(f"{name}: {who} / trussflow", f"{ratio:.1f}", f">= {target:g}")
            )
            if ratio < target:
                failed.append(
                    f"{name}: {who} / trussflow is {ratio:.1f}, and is to be {target:g} at least"
                )
    show(rows)
    print("\n".join(failed))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
