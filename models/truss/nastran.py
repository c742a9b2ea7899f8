"""Structures from Nastran: nodes from a deck, mass and stiffness matrices from an OUTPUT4 file.

Nastran writes the matrices for all freedoms of all nodes by DMAP (``OUTPUT4 KGG,MGG//-1/21 $``). The optional
dependency pyyeti reads the files: ``pip install trussflow[nastran]``.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from trussflow.blocks.errors import Explained
from trussflow.blocks.support.files import destination
from trussflow.models.errors import ModelError
from trussflow.models.truss.structure import Structure
from trussflow.models.validation import check_choice


def structure_from_nastran(
    deck: str | Path,
    matrices: str | Path,
    *,
    units: Sequence[str],
    mass: str = "MGG",
    stiffness: str = "KGG",
) -> Structure:
    """Return a structure from a Nastran deck and the OUTPUT4 matrices of that deck.

    Parameters
    ----------
    deck : str or pathlib.Path
        Bulk data with GRID and CORD2* cards, and its INCLUDE files.
    matrices : str or pathlib.Path
        OUTPUT4 file, binary or text.
    units : sequence of str
        Units of length, mass and time, for example ``("mm", "t", "s")``; Nastran files state none [-].
    mass, stiffness : str
        Names of the matrices in the file, of six freedoms per node in the order of the nodes' numbers and
        in their own output coordinate systems.

    Raises
    ------
    ModelError
        If pyyeti is not installed, a file or a matrix cannot be read, or `Structure.from_matrices` raises.
    """
    try:
        with np.printoptions():  # pyyeti changes the print options of numpy
            from pyyeti.nastran import bulk, n2p, op4
    except ImportError as error:
        raise ModelError(
            "Nastran's files are read by pyyeti; pip install 'trussflow[nastran]'"
        ) from error

    cannot = f"cannot read {str(deck)!r} with {str(matrices)!r}"
    with Explained(lambda error: ModelError(f"{cannot}: {error}")):
        _refuse_devices(Path(deck))
        nodes, _ = bulk.bulk2uset(str(deck))
        # The rigid-body modes of a node by pyyeti begin with the axes of the node.
        moved = n2p.rbgeom_uset(nodes).reshape(-1, 6, 6)
        found = op4.load(str(destination(matrices)), justmatrix=True)
    if not len(nodes):
        raise ModelError(
            f"cannot find GRID cards in {str(deck)!r}; it must be the bulk data of the matrices"
        )
    for name in (mass, stiffness):
        check_choice(f"matrix in {str(matrices)!r}:", name.lower(), found)
    return Structure.from_matrices(
        found[mass.lower()],
        found[stiffness.lower()],
        # pyyeti has six rows per node; the first one has its position.
        nodes[["x", "y", "z"]].to_numpy()[::6],
        units=units,
        nodes=[int(n) for n in nodes.index.get_level_values("id")[::6]],
        axes=np.swapaxes(moved[:, :3, :3], 1, 2),
        source=Path(matrices).name,
    )


def _refuse_devices(deck: Path) -> None:
    """Raise OSError if the deck or an included file is not a regular file, since a device may never end."""
    files = [deck.absolute()]
    for file in files:  # the loop appends to the list
        text = destination(file).read_text(encoding="utf-8", errors="replace")
        for parts in re.findall(
            r"^include[^'\n]*'([^']*)'", text, re.IGNORECASE | re.MULTILINE
        ):
            name = "".join(map(str.strip, parts.splitlines()))
            # As in pyyeti: a bare name is relative to the including file, a path relative to the deck.
            included = (files[0] if os.path.dirname(name) else file).parent / name
            if included not in files:
                files.append(included)
