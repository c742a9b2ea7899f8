"""Map of control spillover: rightmost pole over damping of the modes and bandwidth of the observer.

The model of the controller has six modes, as in the paper; the plant has more. The law is linear. The state
matrix is affine in the damping ratio and in the bandwidth, so four linearizations suffice: the estimate
cancels in the rate of the observer, since the nominal acceleration contains it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from truss_loop import TrussLoop

from trussflow.blocks import Linearizer, OperatingPoint
from trussflow.models import RobotArm, SpaceTruss, TrussDynamics, TrussModes
from trussflow.models.transport import transport_diagram
from trussflow.models.truss.paper_truss import CLAMPED_FACE, paper_structure
from trussflow.models.truss.reduction import reduced_modes

MODEL_MODES = 6
MIN_FREQUENCY = 0.1
"""Poles of lower frequency belong to the law [rad/s]."""

DAMPING = np.array([0.0, 0.05])
BANDWIDTH = np.array([1.0, 4.0])
"""Damping ratios [-] and bandwidths [1/s] of the linearizations."""

Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class StateMatrices:
    """State matrices of a loop, from their values at `DAMPING` and `BANDWIDTH`."""

    values: Matrix

    def at(self, damping: float, bandwidth: float) -> Matrix:
        """Return the state matrix; bandwidth zero: no observer."""
        weights = np.outer(_weights(DAMPING, damping), _weights(BANDWIDTH, bandwidth))
        return np.asarray(np.tensordot(weights, self.values, 2))

    def growth(self, damping: Sequence[float], bandwidth: Sequence[float]) -> Matrix:
        """Return the real part of the rightmost oscillating pole over damping and bandwidth [1/s]."""
        return np.array(
            [[self.rightmost(d, L).real for L in bandwidth] for d in damping]
        )

    def rightmost(self, damping: float, bandwidth: float) -> complex:
        """Return the rightmost oscillating pole [1/s]."""
        poles = np.linalg.eigvals(self.at(damping, bandwidth))
        return complex(
            max(poles[poles.imag > MIN_FREQUENCY], key=lambda pole: pole.real)
        )


def _weights(nodes: Matrix, place: float) -> Matrix:
    """Return the weights of linear interpolation between two nodes, or of extrapolation."""
    share = (place - nodes[0]) / (nodes[1] - nodes[0])
    return np.array([1.0 - share, share])


def truss_with(modes: int) -> SpaceTruss:
    """Return the paper's truss with more modes, from finite elements."""
    grasps = list(TrussModes.reconstructed().grasp_positions)
    shapes = reduced_modes(
        paper_structure(), modes, grasps, clamped=CLAMPED_FACE, attachments=False
    )
    return SpaceTruss(
        TrussDynamics(
            modes=shapes,
            arms=(RobotArm.literal(),) * len(grasps),
            elastic_integrals=True,
        )
    )


def state_matrices(truss: SpaceTruss) -> dict[str, StateMatrices]:
    """Return the loops without work on the modes, with it (Eq. 64), and with mode-neutral feedback."""
    believed = replace(
        truss.dynamics, modes=truss.dynamics.modes.truncated(MODEL_MODES)
    )
    mission = TrussLoop(truss, 1.0, linear=True).mission
    found: dict[str, list[list[Matrix]]] = {
        "published": [],
        "Eq. 64": [],
        "consistent": [],
    }
    for allocation in ("published", "mode-neutral"):
        plant = SpaceTruss(truss.dynamics)
        diagram = transport_diagram(
            mission, plant, allocation=allocation, believed=believed
        )
        wire = ["truss.modal_force"]
        linearizer = Linearizer(diagram, wire, wire, cut=wire)
        for damping in DAMPING:
            models = [
                linearizer.at(
                    OperatingPoint(
                        parameters={
                            "truss.damping_ratio": np.full(truss.modes, damping),
                            "observer.gain": bandwidth,
                        }
                    )
                )
                for bandwidth in BANDWIDTH
            ]
            closed = [model.A + model.B @ model.C for model in models]
            if allocation == "published":
                found["published"].append([model.A for model in models])
                found["Eq. 64"].append(closed)
            else:
                found["consistent"].append(closed)
    return {name: StateMatrices(np.array(matrices)) for name, matrices in found.items()}


def least_damping(growth: Matrix, ratios: Sequence[float]) -> str:
    """Return the least damping ratio from which on the growth rates are negative."""
    unstable = np.flatnonzero(growth >= 0)
    first = unstable[-1] + 1 if unstable.size else 0
    return (
        f"{100 * ratios[first]:g} %"
        if first < len(ratios)
        else f"> {100 * ratios[-1]:g} %"
    )
