"""The paper's L-shaped space truss as a frame of beams, its printed data, and its accurate modes."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from math import cos, fsum, pi, sin

import numpy as np

from trussflow.blocks.support.types import Vector
from trussflow.models.errors import ModelError
from trussflow.models.parameter_files import ParameterTable
from trussflow.models.truss.frame import Frame, FrameMember, meshed
from trussflow.models.truss.reduction import reduced_modes
from trussflow.models.truss.stiffness import Rigidity
from trussflow.models.truss.structure import Structure
from trussflow.models.truss.truss_modes import TrussModes

CLAMPED_FACE = (1, 2, 3, 4)
"""Nodes of the face x = 0, which is clamped in the frame of the truss."""

_COUNTS = (
    "first_arm_modules",
    "second_arm_modules",
    "elements_per_longeron",
    "elements_per_edge",
)
_UNITS = {
    "module_length": "m",
    "width": "m",
    "bend_angle": "rad",
    "rod_radius": "m",
    "youngs_modulus": "Pa",
    "poissons_ratio": "1",
    "mass": "kg",
}


def frame_parameters() -> dict[str, float]:
    """Return the parameters of the reconstructed frame from ``space_truss.toml``, in SI units."""
    return (
        ParameterTable.shipped("space_truss.toml")
        .table("frame")
        .scalars(**dict.fromkeys(_COUNTS, "1"), **_UNITS)
    )


def paper_frame(**changes: float) -> Frame:
    """Return two arms of box modules, of rigidly connected round rods without diagonals.

    Each arm is a row of modules: square frames connected by four longerons. The arms share one mitred frame
    at the bend. The corners of each frame are four nodes: outer low, inner low, inner high, outer high.

    Parameters
    ----------
    **changes : float
        Values in place of those of `frame_parameters`: first_arm_modules and second_arm_modules [-],
        module_length along the outer edge [m], width of the square section [m], bend_angle from the x axis
        to the second arm, negative towards the inner edge [rad], rod_radius [m], youngs_modulus [Pa],
        poissons_ratio [1], mass of the whole truss [kg], and the numbers of beam elements
        elements_per_longeron and elements_per_edge, even [-].
    """
    p = frame_parameters() | changes
    first_arm, second_arm, on_longeron, on_edge = (int(p[name]) for name in _COUNTS)
    corners = _corners(
        first_arm, second_arm, p["module_length"], p["width"], p["bend_angle"]
    )
    frames = range(0, len(corners), 4)
    edges = [(k + c, k + (c + 1) % 4, on_edge) for k in frames for c in range(4)]
    longerons = [(k + c, k + 4 + c, on_longeron) for k in frames[:-1] for c in range(4)]
    members = edges + longerons
    # per length [kg/m]
    density = p["mass"] / fsum(np.concatenate(meshed(corners, members)[2]))
    modulus, moment = p["youngs_modulus"], pi * p["rod_radius"] ** 4 / 4.0
    shear = modulus / (2.0 * (1.0 + p["poissons_ratio"]))
    rod = Rigidity(
        modulus * pi * p["rod_radius"] ** 2,
        modulus * moment * np.eye(3),
        2.0 * shear * moment,
    )
    rods = [
        FrameMember(start + 1, end + 1, n, rod, density) for start, end, n in members
    ]
    return Frame(positions=corners, members=tuple(rods), source=__name__)


def paper_structure(**changes: float) -> Structure:
    """Return the free finite-element model of `paper_frame`, whose nodes are all mesh points.

    Parameters
    ----------
    **changes : float
        As in `paper_frame` [m, rad, Pa, kg, -].
    """
    # Two grasp points of the paper are inside longerons.
    return replace(paper_frame(**changes).structure(), inner=0)


def _corners(
    first_arm: int, second_arm: int, length: float, width: float, bend: float
) -> Vector:
    """Return the corners of the frames, shape (4 (modules + 1), 3) [m]."""
    first, second = np.array([1.0, 0.0]), np.array([cos(bend), sin(bend)])
    right = [np.array([d[1], -d[0]]) for d in (first, second)]
    # The mitre is along the bisector, with the length that gives both arms their width.
    mitre = (right[0] + right[1]) / (1.0 + right[0] @ right[1])
    corners = []
    for k in range(first_arm + second_arm + 1):
        outer = length * (min(k, first_arm) * first + max(k - first_arm, 0) * second)
        inwards = right[0] if k < first_arm else right[1] if k > first_arm else mitre
        inner = outer + width * inwards
        corners += [[*outer, 0.0], [*inner, 0.0], [*inner, width], [*outer, width]]
    return np.array(corners)


def printed_modes() -> ParameterTable:
    """Return the table with the modal data that the paper prints."""
    return ParameterTable.shipped("space_truss.toml").table("modes")


def printed_grasps() -> Vector:
    """Return the grasp points of the paper's Table 2, shape (4, 3) [m]."""
    return printed_modes().array("grasp_points", "m", (None, 3))


def printed_frequencies() -> Vector:
    """Return the natural frequencies of the paper's Table 1, shape (6,) [Hz]."""
    return printed_modes().array("frequencies", "Hz", (None,))


def with_printed_frequencies(modes: TrussModes) -> TrussModes:
    """Return modes of the frame with its lowest frequencies replaced by the paper's.

    Parameters
    ----------
    modes : TrussModes
        Modes of `paper_structure`; frequencies beyond the printed ones are kept.
    """
    printed = printed_frequencies()[: modes.modes]
    frequencies = np.concatenate([printed, modes.frequencies[len(printed) :]])
    paper = f"Li, Wei, Chen (2026), Actuators 15(2), 108, Table 1 for the first {len(printed)} frequencies"
    return replace(modes, frequencies=frequencies, source=f"{modes.source}; {paper}")


@lru_cache(maxsize=8)
def accurate_modes(
    number_of_modes: int = 20, highest_frequency: float = 100.0
) -> TrussModes:
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
        If there are fewer modes than printed frequencies, or `reduced_modes` raises.
    """
    least = len(printed_frequencies())
    if number_of_modes < least:
        raise ModelError(
            f"cannot keep {number_of_modes} modes: the accurate truss has at least the {least} modes whose "
            f"frequencies the paper prints; choose {least} or more"
        )
    modes = reduced_modes(
        paper_structure(),
        number_of_modes,
        list(printed_grasps()),
        clamped=CLAMPED_FACE,
        highest_frequency=highest_frequency,
    )
    return with_printed_frequencies(modes)
