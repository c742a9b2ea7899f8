"""Trusses of the study: the reconstructed one, its mirror image, and the grasp line on the inner longeron."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np

from trussflow.blocks.support.files import replaced
from trussflow.blocks.support.types import Array
from trussflow.models.truss.paper_truss import (
    CLAMPED_FACE,
    frame_parameters,
    paper_structure,
    printed_grasps,
    with_printed_frequencies,
)
from trussflow.models.truss.reduction import reduced_modes
from trussflow.models.truss.structure import Structure
from trussflow.models.truss.truss_modes import TrussModes

PRINTED_MODES, COMPUTED_MODES = 6, 20


def truss_modes(modes: int, folder: Path) -> TrussModes:
    """Return the first modes of the reconstructed truss, with the printed frequencies.

    Parameters
    ----------
    modes : int
        Number of modes, up to 20 [-]; the package contains the first six.
    folder : pathlib.Path
        Folder of the computed modes.
    """
    if modes <= PRINTED_MODES:
        return TrussModes.reconstructed().truncated(modes)
    return with_printed_frequencies(
        frame_modes("reconstructed", folder).truncated(modes)
    )


def frame_modes(variant: str, folder: Path) -> TrussModes:
    """Return 20 modes of the finite-element frame with its own frequencies, computed once.

    The last digits of the eigensolver are not reproducible, so equal runs need the same file.

    Parameters
    ----------
    variant : str
        ``"reconstructed"``, or ``"inner edge"`` with the grasp line on the inner longeron of the bend.
    folder : pathlib.Path
        Folder of the computed modes.
    """
    frame, points = frame_parameters(), printed_grasps()
    key = hashlib.sha256(f"{variant} {frame} {points}".encode()).hexdigest()[:16]
    file = folder / f"modes-{key}.json"
    if not file.exists():
        if variant == "reconstructed":
            modes = _modes(paper_structure(), points)
        else:
            # With the opposite bend the low outer longeron is the inner one. The mirror image of that frame
            # has the grasp points of Table 2.
            other = paper_structure(bend_angle=-frame["bend_angle"])
            modes = mirrored(_modes(other, points * np.array([1.0, -1.0, 1.0])), 1)
        folder.mkdir(parents=True, exist_ok=True)
        with replaced(file) as partial:
            modes.save(partial)
    return TrussModes.load(file)


def _modes(structure: Structure, grasps: Array) -> TrussModes:
    return reduced_modes(
        structure, COMPUTED_MODES, list(grasps), clamped=CLAMPED_FACE, attachments=False
    )


def mirrored(modes: TrussModes, axis: int) -> TrussModes:
    """Return the mirror image of a truss, including the grasp points.

    Parameters
    ----------
    modes : TrussModes
        Truss.
    axis : int
        Component of vectors that changes its sign [-]; rotations change the other two.
    """
    vector = np.ones(3)
    vector[axis] = -1.0
    return replace(
        modes,
        positions=modes.positions * vector,
        shapes=modes.shapes * vector[:, None],
        grasp_positions=modes.grasp_positions * vector,
        grasp_translations=modes.grasp_translations * vector[:, None],
        grasp_rotations=modes.grasp_rotations * -vector[:, None],
    )
