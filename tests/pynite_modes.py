"""Clamped modes of a frame of equal rods by another program, Pynite."""

import numpy as np
import pytest

from trussflow.models.truss.paper_truss import CLAMPED_FACE


def pynite_modes(frame, count, added=()):
    """Return frequencies [Hz], and translations and rotations of the mesh points, mass-normalized.

    `added` holds point masses: index of the mesh point, and mass [kg].
    """
    program = pytest.importorskip(
        "Pynite", reason="Pynite is a second opinion on the modes"
    )
    structure, model, rod = (
        frame.structure(),
        program.FEModel3D(),
        frame.members[0].rigidity,
    )
    masses = structure.mass.diagonal()[::6]
    for node, mass in added:
        masses[node] += mass
    model.add_material("rod", rod.stretching, rod.twisting, 0.3, 0.0)
    moment = rod.bending[0, 0] / rod.stretching
    model.add_section("rod", 1.0, moment, moment, 1.0)
    names = [f"N{i + 1}" for i in range(len(masses))]
    for name, position, mass in zip(names, structure.positions, masses, strict=True):
        model.add_node(name, *position)
        # Pynite converts nodal forces to point masses, here with a "gravity" of one.
        model.add_node_load(name, "FY", -mass, case="mass")
    for i, member in enumerate(frame.members):
        model.add_member(f"M{i}", f"N{member.start}", f"N{member.end}", "rod", "rod")
    for node in CLAMPED_FACE:
        model.def_support(f"N{node}", *[True] * 6)
    model.add_load_combo("mass", {"mass": 1.0})
    model.analyze_modal(count, mass_combo_name="mass", gravity=1.0)
    frequencies = np.asarray(model.frequencies, dtype=float)
    order = np.argsort(frequencies)
    combinations, nodes = (
        [f"Mode {k + 1}" for k in order],
        [model.nodes[name] for name in names],
    )
    translations, rotations = (
        np.array(
            [
                [[getattr(node, f)[c] for c in combinations] for f in fields]
                for node in nodes
            ]
        )
        for fields in (("DX", "DY", "DZ"), ("RX", "RY", "RZ"))
    )
    # Pynite gives massless freedoms a small mass, so its modes are orthonormal to 1e-6 only.
    values, vectors = np.linalg.eigh(
        np.einsum("n,nia,nib->ab", masses, translations, translations)
    )
    normalize = (vectors / np.sqrt(values)) @ vectors.T
    return frequencies[order], translations @ normalize, rotations @ normalize
