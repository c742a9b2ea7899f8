r"""Component modes of the clamped truss: its lowest modes, and what they leave out at the grasps.

No mode of the truss alone bends the rods at a grasp point as the force or the torque of a robot
does, however many are taken. So each unit force and moment on a grasp point adds the static
deflection that is missing, :math:`K^{-1} f - \sum_k \phi_k \phi_k^T f / \omega_k^2`, the residual
attachment shape of MacNeal. Attachment shapes are orthogonal to the modes; among each other they
are made so (Rayleigh–Ritz), and come out as shapes with frequencies of their own.

Some of those frequencies are far above all that matters, and nothing but a burden to the solver:
hardly any mass moves when a rod twists. A shape of frequency f above the highest wanted, F, is
**condensed**: its frequency becomes F, and its displacements and rotations at the grasps become
F / f of what they were. What it gives way under a static load on the grasps, the square of the
quotient, stays exactly the same; that it does so within a vibration of F rather than f is what is
given up. Energy and momentum are conserved as before, since the equations hold for any shapes.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from trussflow.blocks.framework.types import Array
from trussflow.models.errors import ModelError
from trussflow.models.truss.frame_analysis import CLAMPED_NODES
from trussflow.models.truss.stiffness import stiffness_matrix
from trussflow.models.truss.truss_fe import (
    TrussFrame,
    printed_frequencies,
    printed_grasps,
    upward_signs,
    with_printed_frequencies,
)
from trussflow.models.truss.truss_modes import TrussModes

# Kinetic energies of shapes of equal strain energy, the least to the greatest; below this they
# are round-off.
_LEAST_KINETIC = 1e-8


def component_modes(
    frame: TrussFrame, number_of_modes: int, grasp_points: Array, *, highest_frequency: float = np.inf
) -> TrussModes:
    """Return the lowest modes of a frame and its attachment shapes at the grasps, undamped.

    Parameters
    ----------
    frame : TrussFrame
        The truss.
    number_of_modes : int
        Modes of the clamped frame, h [-].
    grasp_points : array, shape (k, 3)
        Each within 2 mm of a mesh point, whose shapes it gets [m].
    highest_frequency : float
        Attachment shapes of higher frequencies are condensed [Hz].

    Returns
    -------
    TrussModes
        First the h modes, then six attachment shapes per grasp point that is not clamped.
        Frequencies ascend.

    Raises
    ------
    ModelError
        If a grasp point is not at a mesh point, so many shapes cannot be had, or a mode lies
        above `highest_frequency`.

    References
    ----------
    MacNeal (1971), *A hybrid method of component mode synthesis*; Craig (2000), *Coupling of
    substructures for dynamic analyses: an overview*.
    """
    positions, masses = frame.point_masses()
    points = np.asarray(grasp_points, dtype=float)
    nodes = np.array(frame.mesh_points(points))
    gripped = np.unique(nodes[nodes >= CLAMPED_NODES]) - CLAMPED_NODES
    frame.check_number_of_modes(number_of_modes + 6 * len(gripped))
    held = 6 * CLAMPED_NODES
    stiffness = stiffness_matrix(frame)[held:, held:].toarray()
    mass = np.repeat(masses[CLAMPED_NODES:], 3)
    freedoms = np.arange(len(stiffness)).reshape(-1, 6)
    moving, turning = freedoms[:, :3].ravel(), freedoms[:, 3:].ravel()

    # Rotations carry no mass: they follow the displacements.
    twisting = stiffness[np.ix_(turning, turning)]
    every = np.zeros((len(stiffness), len(moving)))
    every[moving] = np.diag(1.0 / np.sqrt(mass))
    every[turning] = -np.linalg.solve(twisting, stiffness[turning][:, moving] / np.sqrt(mass))
    squares, vectors = np.linalg.eigh(every.T @ stiffness @ every)
    modes, others = np.split(every @ vectors, [number_of_modes], axis=1)
    lowest, higher = np.split(squares, [number_of_modes])

    # What the modes leave out is what the others give, and the twist that moves no mass.
    loads = np.eye(len(stiffness))[:, freedoms[gripped].ravel()]
    residual = others / higher @ (others.T @ loads)
    residual[turning] += np.linalg.solve(twisting, loads[turning])
    # In shapes of unit strain energy; their kinetic energies are then 1 / omega^2.
    energy = np.linalg.cholesky(residual.T @ stiffness @ residual)
    shapes = np.linalg.solve(energy, residual.T).T
    kinetic, vectors = np.linalg.eigh(shapes[moving].T * mass @ shapes[moving])
    if np.any(kinetic < _LEAST_KINETIC * np.max(kinetic, initial=0.0)):
        raise ModelError(
            f"cannot add attachment shapes to {number_of_modes} modes: these move all the mass there is "
            "near the grasp points; ask for fewer modes"
        )
    attachments = (shapes @ vectors / np.sqrt(kinetic))[:, ::-1]

    frequencies = np.sqrt(np.concatenate([lowest, 1.0 / kinetic[::-1]])) / (2.0 * np.pi)
    if number_of_modes and not frequencies[number_of_modes - 1] < highest_frequency:
        raise ModelError(
            f"highest_frequency is {highest_frequency} Hz, but mode {number_of_modes} has "
            f"{frequencies[number_of_modes - 1]:.4g} Hz; only attachment shapes can be condensed: "
            "ask for fewer modes or a higher frequency"
        )
    found = np.zeros((len(positions), 6, len(frequencies)))
    found[CLAMPED_NODES:] = np.hstack([modes, attachments]).reshape(-1, 6, len(frequencies))
    found *= upward_signs(found[nodes[-1], :3])
    at_grasps = found[nodes] * np.minimum(1.0, highest_frequency / frequencies)
    return TrussModes(
        positions=positions,
        masses=masses,
        shapes=found[:, :3],
        frequencies=np.minimum(frequencies, highest_frequency),
        damping_ratios=np.zeros(len(frequencies)),
        grasp_positions=points,
        grasp_translations=at_grasps[:, :3],
        grasp_rotations=at_grasps[:, 3:],
        source=f"{__name__}: {number_of_modes} modes, {6 * len(gripped)} attachment shapes",
    )


@lru_cache(maxsize=8)
def accurate_modes(number_of_modes: int = 20, highest_frequency: float = 100.0) -> TrussModes:
    """Return the paper's truss with attachment shapes at the grasps, undamped.

    The first six frequencies are the paper's, in place of the frame's, which are 0.1 % lower:
    so the first six modes are those of `TrussModes.reconstructed`, and what is added is
    orthogonal to them.

    Parameters
    ----------
    number_of_modes : int
        Of the clamped truss, besides the attachment shapes; six or more [-].
    highest_frequency : float
        Attachment shapes of higher frequencies are condensed [Hz].

    Raises
    ------
    ModelError
        If there are fewer modes than printed frequencies, or as `component_modes` raises.
    """
    least = len(printed_frequencies())
    if number_of_modes < least:
        raise ModelError(
            f"cannot keep {number_of_modes} modes: the accurate truss has the {least} whose "
            f"frequencies the source prints; ask for {least} or more"
        )
    frame = TrussFrame.reconstructed()
    modes = component_modes(frame, number_of_modes, printed_grasps(), highest_frequency=highest_frequency)
    return replace(with_printed_frequencies(modes), source=f"{modes.source}; Table 1 for the first {least}")
