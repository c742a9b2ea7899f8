r"""Poles of the closed loop: damping, and which modes, channels and actuators take part.

With right and left eigenvectors r and l, :math:`l^T r = 1`, of the closed loop's matrix,
:math:`|l_k r_k|` says how much state k takes part in a pole, and opening input j a little, that
is multiplying what it is sent by :math:`1 + \epsilon`, moves the pole at the rate

.. math:: \frac{\partial \lambda}{\partial \epsilon} = (l^T B_j)(C_j r).

A positive real part: that feedback drives the pole to the right. This is how control spillover
shows which feedback feeds which mode. Sources: Pérez-Arriaga, Verghese, Schweppe (1982),
*Selective modal analysis*; Gawronski (2004), *Advanced Structural Dynamics and Active Control
of Structures*, section 11.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.framework.types import Vector
from trussflow.blocks.linear_analysis.modal_table import oscillating_modes
from trussflow.models.modal_analysis.linear_loop import OpenLoop, channel_names

GROUPS = ("translation", "rotation", "joints", "modes", "controller")


@dataclass(frozen=True, slots=True, eq=False)
class Pole:
    """One pole of a closed loop, or the upper one of a pair.

    Attributes
    ----------
    value : complex
        [1/s].
    participation : dict of str to float
        Of translation, rotation, joints, modes and controller states; they sum to one [1].
    modal_participation : Vector, shape (h,)
        Of each mode, out of the same sum [1].
    channel_rates : Vector, shape (34,)
        Rate at which feedback through each demand channel moves the pole [1/s].
    modal_rates : Vector, shape (h,)
        The same for what reaches each mode as modal force; zero if actuators do no work there.
    actuator_rates : Vector, shape (52,)
        The same for each actuator [1/s].
    """

    value: complex
    participation: dict[str, float]
    modal_participation: Vector
    channel_rates: NDArray[np.complex128]
    modal_rates: NDArray[np.complex128]
    actuator_rates: NDArray[np.complex128]

    @property
    def frequency(self) -> float:
        """Natural frequency [rad/s]."""
        return abs(self.value)

    @property
    def damping_ratio(self) -> float:
        """Fraction of critical damping; negative if unstable [1]."""
        return -self.value.real / abs(self.value) if self.value else 1.0


def poles(loop: OpenLoop, number: int | None = None) -> list[Pole]:
    """Return the oscillating poles of a closed loop, rightmost first, one of each pair.

    Those with more than 99.5 % of critical damping are left out: the law's own real poles,
    34-fold, come out as such pairs.

    Parameters
    ----------
    loop : OpenLoop
        The loop.
    number : int, optional
        How many; by default all.
    """
    modes = sorted(oscillating_modes(loop.closed_matrix), key=lambda mode: -mode[0].real)
    demand, force, actuation = _inputs(loop)
    found = []
    for value, l, r in modes[:number]:  # noqa: E741 - its name in the formula
        share = np.abs(l * r) / np.abs(l * r).sum()
        rates = ((l @ B) * (C @ r) for B, C in (demand, force, actuation))
        found.append(Pole(value, *_grouped(loop, share), *rates))
    return found


def _grouped(loop: OpenLoop, share: Vector) -> tuple[dict[str, float], Vector]:
    """Return the participation of each group of states, and of each mode."""
    n, m = loop.rigid + loop.modes, loop.rigid
    by_coordinate = share[:n] + share[n : 2 * n]
    parts = [by_coordinate[:3], by_coordinate[3:6], by_coordinate[6:m], by_coordinate[m:]]
    sums = [float(part.sum()) for part in (*parts, share[2 * n :])]
    return dict(zip(GROUPS, sums, strict=True)), by_coordinate[m:]


def _inputs(loop: OpenLoop) -> list[tuple[Vector, Vector]]:
    """Return B and C of the closed loop's demand, modal force and actuators."""
    p, k = loop.plant, loop.controller
    m, h = loop.rigid, loop.modes
    y = slice(h + loop.actuators, None)
    padding = np.zeros((k.nstates, p.ninputs))
    B = np.vstack([p.B, padding])
    demand = np.hstack([k.D @ p.C[y], k.C])
    causes, command = p.D[:h, :m], p.D[h : h + loop.actuators, :m]
    acts = float(loop.modal_actuation)
    on_demand = B[:, :m] + acts * B[:, m:] @ causes
    # An actuator's own effect follows from those that all combinations for a demand have: the
    # generalized force is P Q, and the plant is driven by its rigid and its modal part.
    on_actuator = B @ np.vstack([loop.effectiveness[:m], acts * loop.effectiveness[m:]])
    return [(on_demand, demand), (acts * B[:, m:], causes @ demand), (on_actuator, command @ demand)]


def strongest(rates: NDArray[np.complex128], names: list[str], number: int = 3) -> str:
    """Return what moves a pole to the right most, with the rates, for people to read.

    Parameters
    ----------
    rates : array, shape (k,)
        From `Pole` [1/s].
    names : list of str
        Of the inputs.
    number : int
        How many [-].
    """
    order = np.argsort(-rates.real)[:number]
    return ", ".join(f"{names[i]} {rates[i].real:+.2g}" for i in order if rates[i].real > 0)


def actuator_names(robots: int, joints: int) -> list[str]:
    """Return names of the actuators: F_1x ... U_1z ..., then the joints' torques.

    Parameters
    ----------
    robots, joints : int
        Numbers of robots and of all joints [-].
    """
    names = [f"{kind}_{i + 1}{axis}" for i in range(robots) for kind in "FU" for axis in "xyz"]
    return names + channel_names(6 + joints, 0, robots)[6:]


def pole_rows(found: list[Pole], loop: OpenLoop, robots: int = 4) -> list[tuple[Any, ...]]:
    """Return the rows of a table of poles.

    Parameters
    ----------
    found : list of Pole
        From `poles`.
    loop : OpenLoop
        The loop they are of.
    robots : int
        Number of robots [-].
    """
    channels = channel_names(loop.rigid, 0, robots)
    actuators = actuator_names(robots, loop.rigid - 6)
    rows = []
    for pole in found:
        v, mode = pole.value, int(np.argmax(pole.modal_participation))
        rows.append(
            (
                f"{v.real:.4g} ± {v.imag:.4g}j",
                f"{100 * pole.damping_ratio:.2f} %",
                *(f"{pole.participation[g]:.2f}" for g in GROUPS),
                f"{mode + 1}: {pole.modal_participation[mode]:.2f}",
                strongest(pole.channel_rates, channels),
                strongest(pole.actuator_rates, actuators),
            )
        )
    return rows


POLE_HEADER = (
    "pole [1/s]",
    "damping",
    *GROUPS,
    "mode",
    "channels that drive it right [1/s]",
    "actuators that do [1/s]",
)
