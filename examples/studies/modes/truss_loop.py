"""Closed loop of the truss at rest, linear: loop gains, margins, poles, delays and sample times."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import control
import numpy as np
from numpy.typing import NDArray

from trussflow.blocks import Diagram, OperatingPoint, delay_margin, loop_transfer
from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.linear_analysis.loop_transfer import LoopMargins, margins_of
from trussflow.blocks.linear_analysis.margins import (
    channel_responses,
    frequencies_about,
    sensitivities,
)
from trussflow.blocks.linear_analysis.modal_table import oscillating_modes
from trussflow.models import SpaceTruss
from trussflow.models.transport import Mission, transport_diagram

RIGID, ROBOTS, JOINTS = 34, 4, 7
CHANNELS = ["x", "y", "z", "phi", "theta", "psi"]
CHANNELS += [f"theta_{i + 1}_{j + 1}" for i in range(ROBOTS) for j in range(JOINTS)]
GROUPS = {
    "translation": range(3),
    "rotation": range(3, 6),
    "translation and rotation": range(6),
}
GROUPS |= {
    f"joints of Robot {i + 1}": range(6 + JOINTS * i, 13 + JOINTS * i)
    for i in range(ROBOTS)
}

ERROR, OMEGA = 1e-3, 1.0
"""Amplitude [m, rad] and frequency [rad/s] of the errors for describing functions."""

PERIODS = 1e-8, 1.0
"""Range of sample times [s]; the fastest pole of the PD loop is near 1e7 1/s."""


@dataclass(frozen=True)
class TrussLoop:
    """Loop of Case 1; bandwidth None: no observer; linear: exponents one and no switching."""

    truss: SpaceTruss
    bandwidth: float | None = None
    controller: str = "ismc"
    allocation: str | None = None
    linear: bool = False

    @cached_property
    def mission(self) -> Mission:
        """Gains of the law and the observer."""
        mission = replace(Mission.of_case(1), observer_bandwidth=self.bandwidth or 1.0)
        if not self.linear:
            return mission
        return replace(
            mission, exponent=1.0, switching_gain=0.0, conventional_switching_gain=0.0
        )

    @cached_property
    def diagram(self) -> Diagram:
        """Closed loop."""
        return transport_diagram(
            self.mission,
            SpaceTruss(self.truss.dynamics, modal_actuation=self.truss.modal_actuation),
            controller=self.controller,
            observer=self.bandwidth is not None,
            allocation=self.allocation,
        )

    @cached_property
    def demand(self) -> str:
        """Input of the allocation: forces, torques and joint torques."""
        neutral = "feedback_allocation" in self.diagram.blocks
        return (
            f"feedback_allocation.demand[:{RIGID}]" if neutral else "allocation.demand"
        )

    @cached_property
    def point(self) -> OperatingPoint:
        """Initial states, and the gains of the describing functions of the law."""
        if self.linear or self.controller == "pd":
            return OperatingPoint()
        law = self.mission
        if self.controller == "smc":
            sliding = ERROR * abs(law.surface_slope + 1j * OMEGA)
            # Within this layer, the slope is that of the describing function of the switching term.
            layer = np.pi / 4 * sliding
            return OperatingPoint(parameters={"controller.boundary_layer": layer})
        power = law.exponent
        gamma = law.rate_gain * _power_gain(power, ERROR * OMEGA)
        mu = law.error_gain * _power_gain(power / (2 - power), ERROR)
        sliding = ERROR * abs(1j * OMEGA + gamma + mu / (1j * OMEGA))
        reaching = control.describing_function(
            lambda s: s / (abs(s) + law.boundary_layer), sliding
        )
        gains = {
            "gamma": gamma,
            "mu": mu,
            "beta": 1.0,
            "eta": 0.0,
            "sigma": law.reaching_gain + law.switching_gain * reaching.real.item(),
        }
        named = {f"controller.{name}": gain for name, gain in gains.items()}
        return OperatingPoint(parameters=named)

    @cached_property
    def demand_loop(self) -> control.StateSpace:
        """Loop gain at the demand."""
        return loop_transfer(self.diagram, self.demand, at=self.point)

    @cached_property
    def modal_loop(self) -> control.StateSpace:
        """Loop gain at the modal force."""
        return loop_transfer(self.diagram, "truss.modal_force", at=self.point)

    @cached_property
    def closed(self) -> NDArray[np.float64]:
        """State matrix of the closed loop; the loop gain has no direct feedthrough."""
        loop = self.demand_loop
        return np.asarray(loop.A - loop.B @ loop.C)

    def omega(self, high: float = 1e4, points: int = 600) -> NDArray[np.float64]:
        """Return frequencies around all poles, open and closed [rad/s]."""
        poles = np.concatenate(
            [np.linalg.eigvals(A) for A in (self.closed, self.demand_loop.A)]
        )
        return frequencies_about(poles, high=high, points=points)

    def margins(self, channels: range, points: int = 600) -> LoopMargins:
        """Return the margins of some channels of the demand, the loops through the others closed."""
        loop = self.demand_loop
        others = np.setdiff1d(range(RIGID), channels)
        A = loop.A - loop.B[:, others] @ loop.C[others]
        names = [CHANNELS[k] for k in channels]
        opened = control.ss(A, loop.B[:, channels], loop.C[channels], 0, inputs=names)
        return margins_of(opened, self.omega(points=points))

    def gains(
        self, loop: control.StateSpace, omega: NDArray[np.float64]
    ) -> NDArray[np.complex128]:
        """Return the loop gain of each channel, the others closed."""
        return channel_responses(sensitivities(loop, omega))

    def poles(self, number: int) -> list[tuple[str, ...]]:
        r"""Return rows about the rightmost oscillating poles: value, damping, participation, channels.

        A state takes part by :math:`|l_k r_k|`. More feedback in channel j, by the factor
        :math:`1 + \epsilon`, moves the pole at the rate :math:`-(l^T B_j)(C_j r)`.
        """
        loop = self.demand_loop
        of_truss = [label.startswith("truss/") for label in loop.state_labels]
        places = [int(label.split("[")[1][:-1]) for label in loop.state_labels]
        coordinate = np.where(of_truss, places, -1)
        ends = [0, 3, 6, RIGID, np.inf]
        rows = []
        closed = control.ss(self.closed, loop.B, loop.C, 0)
        for pole, left, right in sorted(
            oscillating_modes(closed), key=lambda m: -m[0].real
        )[:number]:
            share = np.abs(left * right) / np.abs(left * right).sum()
            parts = [
                share[(a <= coordinate) & (coordinate < b)].sum()
                for a, b in pairwise(ends)
            ]
            modal = [
                share[coordinate == RIGID + k].sum() for k in range(self.truss.modes)
            ]
            rates = -((left @ loop.B) * (loop.C @ right)).real
            strongest = [k for k in np.argsort(-rates)[:3] if rates[k] > 0]
            rows.append(
                (
                    f"{pole.real:.4g} ± {pole.imag:.4g}j",
                    f"{-100 * pole.real / abs(pole):.2f} %",
                    *(f"{part:.2f}" for part in (*parts, 1 - sum(parts))),
                    f"{np.argmax(modal) + 1}: {max(modal):.2f}",
                    ", ".join(f"{CHANNELS[k]} {rates[k]:+.2g}" for k in strongest),
                )
            )
        return rows

    def timing(self, points: int) -> list[str]:
        """Return the largest delay, its oscillation, and two largest sample times [ms, rad/s, ms]."""
        fastest = float(np.abs(np.linalg.eigvals(self.closed)).max())
        try:
            delay, omega = delay_margin(
                self.demand_loop, omega=self.omega(10 * fastest, 4 * points)
            )
        except LinearAnalysisError:
            return ["unstable", "-", "-", "-"]
        # States of the truss are measured; with the demand cut it does not depend on the other states.
        loop = self.demand_loop
        truss = np.array([label.startswith("truss/") for label in loop.state_labels])
        rest = ~truss
        count = int(truss.sum())
        plant = control.ss(
            loop.A[np.ix_(truss, truss)], loop.B[truss], np.eye(count), 0
        )
        law = control.StateSpace(
            *(
                loop.A[np.ix_(rest, rest)],
                loop.A[np.ix_(rest, truss)],
                -loop.C[:, rest],
                -loop.C[:, truss],
            ),
            remove_useless_states=False,
        )
        periods = [
            largest_sample_time(plant, law, late=late, points=points)
            for late in (False, True)
        ]
        return [
            f"{value:.3g}"
            for value in (1e3 * delay, omega, 1e3 * periods[0], 1e3 * periods[1])
        ]


def _power_gain(exponent: float, amplitude: float) -> float:
    """Return the describing function of ``sign(x) |x|^exponent`` at an `amplitude` [unit of x]."""
    found = control.describing_function(
        lambda x: np.sign(x) * abs(x) ** exponent, amplitude
    )
    return float(found.real.item())


def largest_sample_time(
    plant: control.StateSpace, law: control.StateSpace, *, late: bool, points: int
) -> float:
    """Return the first sample time on the way up at which the sampled loop is unstable, to 0.1 % [s].

    Commands are held for one sample, and sent one sample after the measurement if `late`. Zero if already
    the shortest of `PERIODS` is unstable, infinite if none is.
    """

    def stable(period: float) -> bool:
        body = control.c2d(plant, period)
        if late:
            size = plant.ninputs
            hold = (
                np.zeros((size, size)),
                np.eye(size),
                np.eye(size),
                np.zeros((size, size)),
            )
            body = body * control.StateSpace(*hold, period)
        poles = control.feedback(body, control.c2d(law, period), sign=1).poles()
        return bool(np.abs(poles).max() <= 1 + 1e-9)

    periods = np.geomspace(*PERIODS, points)
    if not stable(periods[0]):
        return 0.0
    for low, high in pairwise(periods.tolist()):
        if not stable(high):
            while high > low * 1.001:
                middle = (low * high) ** 0.5
                low, high = (middle, high) if stable(middle) else (low, middle)
            return low
    return float("inf")
