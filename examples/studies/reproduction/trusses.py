"""The trusses that the report compares: the reconstructed one and its alternatives."""

from __future__ import annotations

import inspect
from dataclasses import replace
from pathlib import Path

import numpy as np
from study_tools.cache import digest_of

from trussflow.blocks.framework.types import Array
from trussflow.models.parameter_files import shipped_file
from trussflow.models.truss import paper_truss, reduction
from trussflow.models.truss.paper_truss import CLAMPED_FACE, with_printed_frequencies
from trussflow.models.truss.structure import Structure
from trussflow.models.truss.truss_modes import TrussModes
from trussflow.models.validation import check_choice

PRINTED_MODES, MOST_MODES = 6, 20

VARIANTS = ("reconstructed", "other side", "inner edge")
"""Truss above the grasp line (z > 0) and on its inner side; below it; on its outer side."""


def truss_modes(variant: str, modes: int, folder: Path) -> TrussModes:
    """Return modal data of one of the trusses.

    Parameters
    ----------
    variant : str
        One of `VARIANTS`.
    modes : int
        Number of modes [-]; up to six of the reconstructed truss come with the package.
    folder : pathlib.Path
        Where computed modes are kept: the eigensolver does not repeat to the last digit, so
        runs that are to be recognised need the same file.

    Returns
    -------
    TrussModes

    Raises
    ------
    ModelError
        If there is no such variant.
    """
    check_choice("truss variant", variant, VARIANTS)
    if variant == "other side":
        return mirrored(truss_modes("reconstructed", modes, folder), 2)
    if variant == "reconstructed" and modes <= PRINTED_MODES:
        return TrussModes.reconstructed().truncated(modes)
    return with_printed_frequencies(frame_modes(variant, folder).truncated(modes))


def frame_modes(variant: str, folder: Path) -> TrussModes:
    """Return 20 modes of the finite-element frame with its own frequencies, computed once.

    Parameters
    ----------
    variant : str
        ``"reconstructed"`` or ``"inner edge"``.
    folder : pathlib.Path
        Where they are kept.
    """
    sources = [inspect.getsource(module) for module in (paper_truss, reduction)]
    sources.append(shipped_file("space_truss.toml").read_text("utf-8"))
    file = folder / f"modes-{digest_of([variant, str(MOST_MODES), *sources])}.json"
    if not file.exists():
        found = _computed(variant)
        folder.mkdir(parents=True, exist_ok=True)
        found.save(file)
    return TrussModes.load(file)


def prepare(folder: Path) -> None:
    """Compute all modes that runs may ask for, before processes do so at the same time.

    Parameters
    ----------
    folder : pathlib.Path
        Where they are kept.
    """
    for variant in ("reconstructed", "inner edge"):
        frame_modes(variant, folder)


def mirrored(modes: TrussModes, axis: int) -> TrussModes:
    """Return the mirror image of a truss, grasp points included.

    Parameters
    ----------
    modes : TrussModes
        The truss.
    axis : int
        The component of vectors that changes its sign [-]; rotations change the others.
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


def _computed(variant: str) -> TrussModes:
    parameters, points = paper_truss.frame_parameters(), paper_truss.printed_grasps()
    if variant == "reconstructed":
        return _modes(paper_truss.paper_structure(), points)
    # Bent the other way the low outer longeron is the inner one; the mirror image of that
    # frame has the grasp points where Table 2 has them.
    other = paper_truss.paper_structure(bend_angle=-parameters["bend_angle"])
    return mirrored(_modes(other, points * np.array([1.0, -1.0, 1.0])), 1)


def _modes(structure: Structure, points: Array) -> TrussModes:
    return reduction.reduced_modes(
        structure, MOST_MODES, list(points), clamped=CLAMPED_FACE, attachments=False
    )
