"""Clamped modes of the truss frame, by Pynite (PyNiteFEA).

The freedoms of a node are its displacement [m] and its rotation [rad], in truss axes. Rotations
have no inertia.
"""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.framework.types import Vector

if TYPE_CHECKING:
    from trussflow.models.truss.truss_fe import TrussFrame

CLAMPED_NODES = 4
"""Number of clamped nodes: the first mesh points, which are the corners of the face x = 0."""

_MASS_CASE, _MASS_COMBINATION = "mass", "mass"


def eigenmodes(frame: TrussFrame, count: int) -> tuple[Vector, Vector, Vector]:
    """Return the lowest modes of the clamped frame, with order and scale of Pynite.

    Parameters
    ----------
    frame : TrussFrame
        Frame with n mesh points.
    count : int
        Number of modes, h [-].

    Returns
    -------
    frequencies : array, shape (h,)
        Natural frequencies [Hz].
    translations : array, shape (n, 3, h)
        Mode shapes at the mesh points [kg^-½].
    rotations : array, shape (n, 3, h)
        Rotations of the modes at the mesh points [rad/(kg^½·m)].
    """
    model, names = _analysed(frame, count)
    combinations = [f"Mode {k + 1}" for k in range(count)]
    nodes = [model.nodes[name] for name in names]
    translations, rotations = (
        np.array([[[getattr(node, f)[c] for c in combinations] for f in fields] for node in nodes])
        for fields in (("DX", "DY", "DZ"), ("RX", "RY", "RZ"))
    )
    return np.asarray(model.frequencies, dtype=float), translations, rotations


def _analysed(frame: TrussFrame, count: int) -> tuple[Any, list[str]]:
    """Return the Pynite model after a modal analysis, and its names of the mesh points."""
    from Pynite import FEModel3D  # slow to import, and needed only here

    positions, masses = frame.point_masses()
    model: Any = FEModel3D()
    radius, modulus = frame.rod_radius, frame.youngs_modulus
    shear = modulus / (2.0 * (1.0 + frame.poissons_ratio))
    bending = pi * radius**4 / 4.0
    model.add_material("rod", modulus, shear, frame.poissons_ratio, 0.0)
    model.add_section("rod", pi * radius**2, bending, bending, 2.0 * bending)
    names = [f"N{i}" for i in range(len(positions))]
    for name, position, mass in zip(names, positions, masses, strict=True):
        model.add_node(name, *position)
        # Pynite converts nodal forces to point masses, here with a "gravity" of one.
        model.add_node_load(name, "FY", -mass, case=_MASS_CASE)
    for i, (start, end, _) in enumerate(frame.members()):
        model.add_member(f"M{i}", names[start], names[end], "rod", "rod")
    for name in names[:CLAMPED_NODES]:
        model.def_support(name, *[True] * 6)
    model.add_load_combo(_MASS_COMBINATION, {_MASS_CASE: 1.0})
    model.analyze_modal(count, mass_combo_name=_MASS_COMBINATION, gravity=1.0)
    return model, names
