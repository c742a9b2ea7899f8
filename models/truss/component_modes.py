"""Component modes of the paper's truss: its lowest modes and attachment shapes at the grasp points."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from trussflow.blocks.framework.types import Array
from trussflow.models.errors import ModelError
from trussflow.models.truss.frame_analysis import CLAMPED_NODES
from trussflow.models.truss.reduction import reduced_modes
from trussflow.models.truss.truss_fe import (
    TrussFrame,
    printed_frequencies,
    printed_grasps,
    with_printed_frequencies,
)
from trussflow.models.truss.truss_modes import TrussModes


def component_modes(
    frame: TrussFrame, number_of_modes: int, grasp_points: Array, *, highest_frequency: float = np.inf
) -> TrussModes:
    """Return the lowest modes of a frame and its attachment shapes at the grasps, undamped.

    Parameters
    ----------
    frame : TrussFrame
        Frame of the truss.
    number_of_modes : int
        Number of modes of the clamped frame, h [-].
    grasp_points : array, shape (k, 3)
        Grasp points, each within 2 mm of a mesh point, whose shapes it has [m].
    highest_frequency : float
        Attachment shapes of higher frequencies are condensed [Hz].

    Returns
    -------
    TrussModes
        The h modes, then six attachment shapes per grasp point that is not clamped, both with
        ascending frequencies.

    Raises
    ------
    ModelError
        If a grasp point is not at a mesh point, the mesh has too few modes, or a mode is above
        `highest_frequency`.
    """
    structure, face = frame.structure(), range(1, CLAMPED_NODES + 1)
    return reduced_modes(
        structure, number_of_modes, list(grasp_points), clamped=face, highest_frequency=highest_frequency
    )


@lru_cache(maxsize=8)
def accurate_modes(number_of_modes: int = 20, highest_frequency: float = 100.0) -> TrussModes:
    """Return the paper's truss with attachment shapes at the grasps, undamped.

    The paper's six frequencies replace the first six of the frame, which are 0.1 % lower. So the
    first six modes are those of `TrussModes.reconstructed`, and all others are orthogonal to them.

    Parameters
    ----------
    number_of_modes : int
        Number of clamped modes, besides the attachment shapes; six or more [-].
    highest_frequency : float
        Attachment shapes of higher frequencies are condensed [Hz].

    Raises
    ------
    ModelError
        If there are fewer modes than printed frequencies, or `component_modes` raises.
    """
    least = len(printed_frequencies())
    if number_of_modes < least:
        raise ModelError(
            f"cannot keep {number_of_modes} modes: the accurate truss has at least the {least} modes whose "
            f"frequencies the paper prints; choose {least} or more"
        )
    frame = TrussFrame.reconstructed()
    modes = component_modes(frame, number_of_modes, printed_grasps(), highest_frequency=highest_frequency)
    return replace(with_printed_frequencies(modes), source=f"{modes.source}; Table 1 for the first {least}")
