"""``make bench-solvers``: variable steps beside CasADi's generated C and SciPy, at equal error.

Each contender has the loosest tolerance that reaches the error of the problem. Processor times, the least of
some repetitions. "Steps" leaves out what a run does before and after them. The diffusion needs numba.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp
from scipy.integrate import solve_ivp
from table import Row, show

from trussflow.blocks import Block, Diagram, Output, Simulator, State

REPETITIONS, LONG_ENOUGH = 7, 0.05
TOLERANCES = 10.0 ** -np.arange(3.0, 11.5, 0.5)
POINTS, DIFFUSION_END = 1000, 10.0


@dataclass(frozen=True)
class Problem:
    """Rates of a list of states, their start and end, the error, and the peer of CasADi."""

    rates: Callable[[Any], list[Any]]
    start: tuple[float, ...]
    end: float
    error: float
    peer: str
    scale: float = 1.0  # of the absolute tolerance
    solvers: tuple[str, ...] = ("Rodas5P", "auto")


def kepler(x):
    """Return the rates of an orbit."""
    cube = (x[0] ** 2 + x[1] ** 2) ** 1.5
    return [x[2], x[3], -x[0] / cube, -x[1] / cube]


def van_der_pol(x):
    """Return the rates of a relaxation oscillator."""
    return [x[1], 1000.0 * (1.0 - x[0] ** 2) * x[1] - x[0]]


def robertson(x):
    """Return the rates of three reactions."""
    a, b, c = 0.04 * x[0], 1e4 * x[1] * x[2], 3e7 * x[1] ** 2
    return [b - a, a - b - c, c]


def hires(y):
    """Return the rates of eight reactions (Hairer and Wanner, section IV.10)."""
    bound = 280.0 * y[5] * y[7]
    return [
        -1.71 * y[0] + 0.43 * y[1] + 8.32 * y[2] + 0.0007,
        1.71 * y[0] - 8.75 * y[1],
        -10.03 * y[2] + 0.43 * y[3] + 0.035 * y[4],
        8.32 * y[1] + 1.71 * y[2] - 1.12 * y[3],
        -1.745 * y[4] + 0.43 * y[5] + 0.43 * y[6],
        -bound + 0.69 * y[3] + 1.71 * y[4] - 0.43 * y[5] + 0.69 * y[6],
        bound - 1.81 * y[6],
        1.81 * y[6] - bound,
    ]


PROBLEMS = {
    "Kepler": Problem(
        kepler,
        (0.5, 0.0, 0.0, 3.0**0.5),
        20.0 * np.pi,
        1e-6,
        "erk",
        solvers=("DOP853", "RK45", "auto"),
    ),
    "Van der Pol": Problem(van_der_pol, (2.0, 0.0), 2000.0, 1e-5, "rosenbrock"),
    "Robertson": Problem(robertson, (1.0, 0.0, 0.0), 1e5, 1e-5, "rosenbrock", 1e-6),
    "HIRES": Problem(
        hires,
        (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0057),
        321.8122,
        1e-5,
        "rosenbrock",
        1e-2,
    ),
}


class Equations(Block):
    """The states of a problem."""

    y = Output("size")
    x = State("size")

    def __init__(self, rates, start):
        self.rates, self.start = rates, np.array(start)
        self.size = self.start.size
        super().__init__()

    def initial(self, name, p):
        """Return the start."""
        return self.start

    def output(self, t, x, u, p):
        """Return the states."""
        return {"y": x.x}

    def derivative(self, t, x, u, p):
        """Return the rates."""
        return {"x": self.rates(x.x)}


def simulator(rates, start, end, **settings):
    """Return a simulator that logs the states at the end."""
    diagram = Diagram("problem")
    diagram.add(block=Equations(rates, start))
    return Simulator(diagram, log=["block.y"], log_step=end, **settings)


def least(run):
    """Return the least processor time of a run [s], the mean of as many as take `LONG_ENOUGH`."""
    found = []
    for _ in range(REPETITIONS):
        started, runs = time.process_time(), 0
        while (passed := time.process_time() - started) < LONG_ENOUGH:
            run()
            runs += 1
        found.append(passed / runs)
    return min(found)


def steps_of(one, end):
    """Return the processor time of the steps of a run [s]."""
    with one.opened(end) as run:
        start, run.log = run.x.copy(), None

        def steps():
            run.x[:] = start
            run.go_to(run.origin)
            run.advance(run.end)

        return least(steps)


def generated(problem, tolerance, folder):
    """Return a run of CasADi's generated C."""
    x = ca.SX.sym("x", len(problem.start))
    rates = ca.Function("rates", [x], [ca.vertcat(*problem.rates(ca.vertsplit(x)))])
    begin = ca.MX.sym("begin", x.numel())
    options = {"reltol": tolerance, "abstol": tolerance / 100.0 * problem.scale}
    equations = {"x": begin, "ode": rates(begin)}
    integrator = ca.integrator(
        "integrator", problem.peer, equations, 0.0, problem.end, options
    )
    name = f"{problem.peer}_{problem.rates.__name__}_{-10 * np.log10(tolerance):.0f}"
    source = ca.CodeGenerator(f"{name}.c")
    source.add(ca.Function("run", [begin], [integrator(x0=begin)["xf"]]))
    source.generate(f"{folder}/")
    library = f"{folder}/{name}.so"
    flags = ["-O2", "-march=native", "-shared", "-fPIC"]
    command = ["cc", *flags, f"{folder}/{name}.c", "-o", library, "-lm"]
    subprocess.run(command, check=True)
    external = ca.external("run", library)
    buffer, evaluate = external.buffer()
    start, end = np.array(problem.start), np.zeros(x.numel())
    buffer.set_arg(0, memoryview(start))
    buffer.set_res(0, memoryview(end))

    def run():
        evaluate()
        return end

    run.kept = external, buffer, start
    return run


def small(name, problem, folder):
    """Return the rows of a small problem."""
    exact = solve_ivp(
        lambda _, x: problem.rates(x),
        (0.0, problem.end),
        problem.start,
        "DOP853" if problem.peer == "erk" else "Radau",
        rtol=1e-12,
        atol=1e-14 * problem.scale,
    ).y[:, -1]

    def error(x):
        size = 1.0 if problem.peer == "erk" else np.abs(exact)
        return float((np.abs(x - exact) / size).max())

    def rates(x):
        return np.stack(problem.rates(x))

    for tolerance in TOLERANCES:
        peer = generated(problem, tolerance, folder)
        if error(peer()) <= problem.error:
            break
    times, rows = least(peer), []
    for solver in problem.solvers:
        for tolerance in TOLERANCES:
            settings = {"rtol": tolerance, "atol": tolerance / 100.0 * problem.scale}
            one = simulator(
                rates, problem.start, problem.end, solver=solver, **settings
            )
            result = one.run(problem.end, progress=False)
            if error(result["block.y"].values[-1]) <= problem.error:
                break
        whole = least(lambda one=one: one.run(problem.end, progress=False))
        steps = steps_of(one, problem.end)
        rows.append(
            Row(
                f"{name}, {solver}",
                f"steps {1e3 * steps:.2f} ms, run {1e3 * whole:.2f} ms; {problem.peer} {1e3 * times:.2f} ms; "
                f"ratios {steps / times:.2f} and {whole / times:.2f}",
            )
        )
    return rows


def diffusion():
    """Return the row of the Brusselator with diffusion in one dimension, both species one after the other."""
    import numba

    n, factor = POINTS, (POINTS + 1) ** 2 / 50.0
    place = np.arange(1, n + 1) / (n + 1)
    start = np.concatenate([1.0 + np.sin(2.0 * np.pi * place), np.full(n, 3.0)])

    def rates(x):
        u, v = x[:n], x[n:]
        ends = (1.0, u), (3.0, v)
        spread = [
            factor * np.diff(np.concatenate([[end], w, [end]]), n=2) for end, w in ends
        ]
        made = u * u * v
        return np.concatenate(
            [1.0 + made - 4.0 * u + spread[0], 3.0 * u - made + spread[1]]
        )

    @numba.njit
    def by_hand(_, x):
        found = np.empty_like(x)
        for i in range(n):
            u, v = x[i], x[n + i]
            before = x[i - 1] if i else 1.0, x[n + i - 1] if i else 3.0
            last = i == n - 1
            after = 1.0 if last else x[i + 1], 3.0 if last else x[n + i + 1]
            made = u * u * v
            found[i] = 1.0 + made - 4.0 * u + factor * (before[0] - 2.0 * u + after[0])
            found[n + i] = 3.0 * u - made + factor * (before[1] - 2.0 * v + after[1])
        return found

    line = factor * sp.diags([1.0, -2.0, 1.0], [-1, 0, 1], shape=(n, n))
    lines = sp.block_diag([line, line])

    def slope(_, x):
        u, v = x[:n], x[n:]
        parts = [[2.0 * u * v - 4.0, u * u], [3.0 - 2.0 * u * v, -u * u]]
        return (lines + sp.bmat([[sp.diags(p) for p in row] for row in parts])).tocsc()

    def scipy(method, tolerance):
        return solve_ivp(
            by_hand,
            (0.0, DIFFUSION_END),
            start,
            method,
            rtol=tolerance,
            atol=tolerance / 100.0,
            jac=slope,
        ).y[:, -1]

    exact = scipy("Radau", 1e-9)

    def ours(tolerance):
        return simulator(
            rates,
            start,
            DIFFUSION_END,
            solver="Rodas5P",
            rtol=tolerance,
            atol=tolerance / 100.0,
        )

    def reached(run):
        return next(t for t in TOLERANCES if np.abs(run(t) - exact).max() <= 1e-5)

    times = {}
    for method in ("BDF", "Radau"):
        by_method = partial(scipy, method)
        times[method] = least(partial(by_method, reached(by_method)))

    def end(one):
        return one.run(DIFFUSION_END, progress=False)["block.y"].values[-1]

    one = ours(reached(lambda t: end(ours(t))))
    time_of_ours = least(lambda: end(one))
    others = ", ".join(f"SciPy {m} {1e3 * t:.0f} ms" for m, t in times.items())
    ratio = time_of_ours / min(times.values())
    return Row(
        f"Brusselator, {2 * n} states",
        f"run {1e3 * time_of_ours:.0f} ms; {others}; ratio {ratio:.2f}",
        "<= 1.5",
    )


def main():
    """Print the table."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, problem in PROBLEMS.items():
            rows += small(name, problem, Path(folder))
    show([*rows, diffusion()])


if __name__ == "__main__":
    sys.exit(main())
