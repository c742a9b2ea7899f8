"""Map of control spillover: rightmost pole over damping of the modes and bandwidth of the observer.

The model of the controller has six modes, as in the paper; the plant has more. The law is linear.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from study_tools.stability import rightmost
from truss_loop import TrussLoop

from trussflow.blocks import linearize_over
from trussflow.models import RobotArm, SpaceTruss, TrussDynamics, TrussModes
from trussflow.models.transport import transport_diagram
from trussflow.models.truss.paper_truss import CLAMPED_FACE, paper_structure
from trussflow.models.truss.reduction import reduced_modes

MODEL_MODES = 6
NO_OBSERVER = 1e-9
"""Bandwidth in place of zero, which the observer does not allow [1/s]."""

Poles = NDArray[np.complex128]


def truss_with(modes: int, *, attachments: bool = False) -> SpaceTruss:
    """Return the paper's truss with more `modes`, from finite elements, and with `attachments` shapes if wanted."""
    grasps = list(TrussModes.reconstructed().grasp_positions)
    shapes = reduced_modes(
        paper_structure(), modes, grasps, clamped=CLAMPED_FACE, attachments=attachments
    )
    return SpaceTruss(
        TrussDynamics(
            modes=shapes,
            arms=(RobotArm.literal(),) * len(grasps),
            elastic_integrals=True,
        )
    )


def rightmost_poles(
    truss: SpaceTruss, damping: Sequence[float], bandwidth: Sequence[float]
) -> dict[str, Poles]:
    """Return the rightmost oscillating poles of the loops without work on the modes, with it, and neutral.

    Parameters
    ----------
    truss : SpaceTruss
        Plant.
    damping, bandwidth : sequence of float
        Damping ratios of all modes [-] and bandwidths of the observer [1/s]; zero: no observer.

    Returns
    -------
    dict
        ``published``, ``Eq. 64`` (with work on the modes) and ``consistent`` (mode-neutral feedback), each of
        shape (dampings, bandwidths) [1/s].
    """
    believed = replace(
        truss.dynamics, modes=truss.dynamics.modes.truncated(MODEL_MODES)
    )
    mission = TrussLoop(truss, 1.0, linear=True).mission
    wire = ["truss.modal_force"]
    parameters: dict[str, list[Any]] = {
        "truss.damping_ratio": [np.full(truss.modes, ratio) for ratio in damping],
        "observer.gain": [max(L, NO_OBSERVER) for L in bandwidth],
    }
    found = {}
    for name, allocation in (("Eq. 64", "published"), ("consistent", "mode-neutral")):
        plant = SpaceTruss(truss.dynamics)
        diagram = transport_diagram(
            mission, plant, allocation=allocation, believed=believed
        )
        models = linearize_over(diagram, wire, wire, cut=wire, parameters=parameters)
        closed = [model.A + model.B @ model.C for model in models.values.flat]
        found[name] = np.array([rightmost(A)[0] for A in closed])
        if name == "Eq. 64":
            opened = [rightmost(model.A)[0] for model in models.values.flat]
            found["published"] = np.array(opened)
    shape = len(damping), len(bandwidth)
    return {name: poles.reshape(shape) for name, poles in found.items()}
