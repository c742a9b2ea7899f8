r"""Theorems 1 and 2 of the source, along the trajectories.

Theorem 1: :math:`\|\hat d - d\| \le \xi / L` ultimately, for :math:`\|\dot d\| \le \xi`.
Theorem 2: for :math:`\sigma > \bar J^2 / L` and
:math:`V = (\|s\|^2 + \|\hat d - d\|^2) / 2`,
:math:`\dot V \le -\rho V + \xi^2 / 2 L` with :math:`\rho = \min(\sigma, L - \bar J^2/\sigma)`,
so that V decreases wherever it is above :math:`\xi^2 / 2 \rho L`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trussflow.blocks.framework.types import Vector
from trussflow.models.reproduction.ledger import Ledger
from trussflow.models.reproduction.measures import largest_rate, norm
from trussflow.models.reproduction.results import Results
from trussflow.models.reproduction.style import Curve, Panel, drawing, save
from trussflow.models.rotation import euler_rate_matrix_inverse

RUNS = ("case1", "case2", "case1-pushed", "case2-pushed")
FIGURE = "theorems.png"

SETTLED = 5.0
"""The start has died away after this many time constants 1/L of the observer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """What the theorems say of one run, and what holds.

    Attributes
    ----------
    time : Vector
        [s].
    estimation_error : Vector
        Norm over all channels [m/s^2 and rad/s^2].
    lyapunov : Vector
        V [m^2/s^2 and so on].
    xi, bandwidth, sigma, jacobian : float
        Largest rate of d [m/s^3], L [1/s], sigma [1/s], largest norm of J_g [-].
    """

    time: Vector
    estimation_error: Vector
    lyapunov: Vector
    xi: float
    bandwidth: float
    sigma: float
    jacobian: float

    @property
    def error_bound(self) -> float:
        """Bound of Theorem 1, xi/L."""
        return self.xi / self.bandwidth

    @property
    def settled_error(self) -> float:
        """Largest estimation error once the start has died away."""
        return float(self.estimation_error[self.time > SETTLED / self.bandwidth].max())

    @property
    def least_sigma(self) -> float:
        """What sigma must exceed, J^2/L [1/s]."""
        return self.jacobian**2 / self.bandwidth

    @property
    def rho(self) -> float:
        """Rate at which V falls to its bound [1/s]; negative if sigma is too small."""
        return min(self.sigma, self.bandwidth - self.jacobian**2 / self.sigma)

    @property
    def ultimate_bound(self) -> float:
        """Of V; infinite if sigma is too small."""
        return self.xi**2 / (2 * self.rho * self.bandwidth) if self.rho > 0 else np.inf

    @property
    def slope(self) -> Vector:
        """Rate of V between logged instants."""
        return np.diff(self.lyapunov) / np.diff(self.time)

    @property
    def outside(self) -> Vector:
        """Where V is above its ultimate bound at both ends of an interval."""
        above = self.lyapunov > self.ultimate_bound
        return np.asarray(above[:-1] & above[1:])

    @property
    def rising_outside(self) -> int:
        """Number of intervals outside the bound in which V does not decrease; should be zero."""
        return int(np.count_nonzero(self.slope[self.outside] >= 0))

    @property
    def largest_part_of_slope_bound(self) -> float:
        r"""Largest :math:`\dot V + \rho V` per :math:`\xi^2 / 2L`; at most 1 if the proof holds."""
        middle = (self.lyapunov[1:] + self.lyapunov[:-1]) / 2
        return float((self.slope + self.rho * middle).max() / (self.xi**2 / (2 * self.bandwidth)))


def check(results: Results, run: str) -> Check:
    """Return what the theorems say of a run.

    Parameters
    ----------
    results : Results
        Finished runs.
    run : str
        One with the observer and integral sliding mode.
    """
    result, mission = results[run], results.mission(run)
    difference = result.disturbance_estimate - result.disturbance
    error, sliding = norm(difference), norm(result.sliding_variable)
    attitudes = result.attitude.values[::10]
    jacobian = max(float(np.linalg.norm(euler_rate_matrix_inverse(a), 2)) for a in attitudes)
    return Check(
        time=result["time"].values,
        estimation_error=error,
        lyapunov=(sliding**2 + error**2) / 2,
        xi=largest_rate(result.disturbance),
        bandwidth=mission.observer_bandwidth,
        sigma=mission.reaching_gain,
        jacobian=max(1.0, jacobian),  # the blocks R_t and I have norm one
    )


def section(results: Results, ledger: Ledger, folder: Path) -> str:
    """Write the figure and return the section of the report.

    Parameters
    ----------
    results : Results
        Finished runs.
    ledger : Ledger
        Takes down the numbers.
    folder : pathlib.Path
        Of the report.
    """
    checks = {run: check(results, run) for run in RUNS}
    lines = [
        "| run | L | ξ | ξ/L | largest ‖d̂ − d‖ | slack | J̄ | J̄²/L | σ | slack |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for run, c in checks.items():
        values = {
            "L": (c.bandwidth, "1/s"), "xi": (c.xi, ""), "xi/L": (c.error_bound, ""),
            "settled estimation error": (c.settled_error, ""),
            "slack of Theorem 1": (c.error_bound / c.settled_error, ""),
            "norm of J_g": (c.jacobian, ""), "least sigma": (c.least_sigma, "1/s"),
            "sigma": (c.sigma, "1/s"), "slack of sigma": (c.sigma / c.least_sigma, ""),
        }  # fmt: skip
        lines.append(_row(ledger, run, values))
    lines += [
        "",
        "| run | ρ | ultimate bound of V | largest V | V(0) | time above the bound | intervals "
        "there in which V rises | largest part of the bound on V̇ + ρV |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for run, c in checks.items():
        outside = float(np.sum(np.diff(c.time)[c.outside]))
        values = {
            "rho": (c.rho, "1/s"), "ultimate bound of V": (c.ultimate_bound, ""),
            "largest V": (float(c.lyapunov.max()), ""), "V at the start": (c.lyapunov[0], ""),
            "time of V above its bound": (outside, "s"),
            "rises of V above its bound": (c.rising_outside, ""),
            "largest part of the bound on the slope": (c.largest_part_of_slope_bound, ""),
        }  # fmt: skip
        lines.append(_row(ledger, run, values))
    save(drawing(_panels(checks)), folder / FIGURE)
    return TEXT.format(
        table="\n".join(lines), figure=FIGURE, verdict=_verdict(checks), settled=f"{SETTLED:g}"
    )


def _row(ledger: Ledger, run: str, values: dict[str, tuple[float, str]]) -> str:
    shown = [
        ledger(f"{run}: {name}", value, unit, runs=[run])
        for name, (value, unit) in values.items()
    ]
    return f"| `{run}` | " + " | ".join(shown) + " |"


def _verdict(checks: dict[str, Check]) -> str:
    first = all(c.settled_error <= c.error_bound for c in checks.values())
    gain = all(c.sigma > c.least_sigma for c in checks.values())
    falls = all(c.rising_outside == 0 for c in checks.values())
    proof = all(c.largest_part_of_slope_bound <= 1 for c in checks.values())
    words = [
        f"The bound of Theorem 1 {'holds' if first else 'is violated'} in "
        f"{'every' if first else 'some'} run.",
        f"σ > J̄²/L {'holds' if gain else 'does not hold'}.",
        f"Outside its ultimate bound V {'always decreases' if falls else 'does not always decrease'}"
        f", and the inequality of the proof, V̇ ≤ −ρV + ξ²/2L, "
        f"{'holds' if proof else 'is violated'} at "
        f"{'every instant' if proof else 'some instants'}.",
    ]
    quiet = [run for run, c in checks.items() if not c.outside.any()]
    if quiet:
        names = " and ".join(f"`{run}`" for run in quiet)
        words.append(f"In {names} V never leaves its bound, so that nothing is shown there.")
    return " ".join(words)


def _panels(checks: dict[str, Check]) -> list[Panel]:
    found = []
    for run, c in checks.items():
        late = c.time > 0
        found += [
            Panel(
                curves=[Curve("‖d̂ − d‖", c.time[late], c.estimation_error[late])],
                levels=(c.error_bound,), y="estimation error", log=True, title=run,
            ),
            Panel(
                curves=[Curve("V", c.time[late], np.maximum(c.lyapunov[late], 1e-16))],
                levels=(c.ultimate_bound,) if np.isfinite(c.ultimate_bound) else (),
                y="V", log=True,
            ),
        ]  # fmt: skip
    return found


TEXT = """\
ξ is taken from the runs (largest difference quotient of the logged disturbance, so at most the
true one), J̄ as the largest spectral norm of J_g met. All norms are over the 34 channels, m and rad
alike, as in the source. ‖d̂ − d‖ counts once the start has died away, after {settled}/L. The pushed
runs start with a velocity error, since at rest V starts at zero and the theorem has nothing to do.

{table}

{verdict}

![Theorems along the trajectories]({figure})

Dashed: the bounds.
"""
