"""Self-contained HTML page of a run, without network, server or other files."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape, unescape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from trussflow.blocks.support.files import replaced
from trussflow.blocks.support.packing import compressed
from trussflow.blocks.support.texts import package_text, page_text, script_json
from trussflow.models.errors import ModelError
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.viewer.motion import Motion, opened
from trussflow.models.viewer.scene import plant_of, scene_of

if TYPE_CHECKING:
    import xarray as xr

SHOWN = (
    "position",
    "task_position",
    "position_error",
    "error",
    "base_force",
    "modal_coordinate",
    "base_torque",
    "energy",
)
"""Signals of the initial charts, if logged."""
INITIAL_CHARTS = 4
MAX_PAGE_BYTES = 4_000_000
"""Largest size of a page [byte]."""
NO_ROOM = 1e-9
"""Share of numbers per page with only the first and the last instant [-]."""


@dataclass(frozen=True, slots=True)
class Section:
    """Section of the page below the picture.

    Attributes
    ----------
    title : str
        Heading.
    content : str
        HTML text; an element with the attribute ``data-signal`` becomes a chart of the signal of that name.
    """

    title: str
    content: str


def replay(
    result: xr.Dataset | str | Path,
    truss: SpaceTruss | str | None,
    path: str | Path,
    *,
    other: xr.Dataset | str | Path | None = None,
    names: Sequence[str] = ("run", "other run"),
    target: npt.ArrayLike | None = None,
    rods: npt.ArrayLike | None = None,
    title: str = "Replay",
    sections: Sequence[Section] = (),
) -> Path:
    """Write a page of a run, with the moving truss and charts of all logged signals.

    Parameters
    ----------
    result : xarray.Dataset, str or pathlib.Path
        Result of `simulate`, or its file.
    truss : SpaceTruss, str or None
        Plant of the run, or its name: ``"published"``, ``"consistent"``, ``"accurate"``; None for the name in
        the result of a mission.
    path : str or pathlib.Path
        File to write.
    other : xarray.Dataset, str or pathlib.Path, optional
        Second run, shown over the first; its plant is that named in it, otherwise `truss`.
    names : sequence of str
        Names of the two runs.
    target : array_like, optional
        Task coordinates of the target pose, drawn transparently [m, rad]; by default the attribute ``target``
        of the result.
    rods : array_like, shape (k, 2), optional
        Pairs of point masses connected by a rod [-]; required except for the shipped trusses.
    title : str
        Title of the page.
    sections : sequence of Section
        Further sections below the picture.

    Returns
    -------
    pathlib.Path
        Path of the page.

    Raises
    ------
    ModelError
        If a result is no run of that truss, or lacks ports: log its ``coordinates``, or ``task_position`` and
        ``modal_coordinate``; ``base_force`` and ``base_torque`` are the arrows. If a section names another
        signal than those logged, or the page cannot be written.

    Examples
    --------
    ::

        log = [truss.task_position, truss.modal_coordinate, truss.base_force, truss.base_torque]
        replay(simulate(loop, 80.0, step=1e-3, log=log, log_step=0.02), truss, "replay.html")
    """
    if np.shape(names) != (2,):
        raise ModelError(f"names must be two, one per run; got {names!r}")
    data = [opened(each) for each in (result, other) if each is not None]
    motions = []
    for k, each in enumerate(data):
        named = None if k and "plant" in each.attrs else truss
        motions.append(Motion(each, plant_of(named, each.attrs)))
    first = motions[0]
    goal = first.target(target)
    for section in sections:
        for signal in re.findall(r'data-signal="([^"]*)"', section.content):
            if not any(unescape(signal) in motion.signals for motion in motions):
                raise ModelError(
                    f"section '{section.title}': no signal '{unescape(signal)}' in the run; it has: "
                    f"{', '.join(first.signals)}"
                )
    ports = {name: name.rpartition(".")[2] for name in first.signals}
    # Other signals follow those of SHOWN.
    ranks = {name: (*SHOWN, port).index(port) for name, port in ports.items()}

    def written(room: float) -> bytes:
        """Return the page with a share `room` of the numbers of a page that compresses well."""
        head = {
            "runs": [
                {
                    "name": name,
                    "truss": scene_of(motion.truss, rods),
                    **motion.data(room / len(data)),
                }
                for name, motion in zip(names, motions, strict=False)
            ],
            "target": goal,
            "shown": sorted(ranks, key=ranks.__getitem__)[:INITIAL_CHARTS],
            "exaggeration": first.exaggeration(),
        }
        return _text(title, head, sections).encode("utf-8")

    room = 1.0
    while len(page := written(room)) > MAX_PAGE_BYTES:  # noise hardly compresses
        if room < NO_ROOM:
            raise ModelError(
                f"cannot show the run in a page of {MAX_PAGE_BYTES / 1e6:g} MB: truss, sections and names of "
                f"signals alone take {len(page) / 1e6:.1f} MB; use a truss with fewer points or modes"
            )
        room *= 0.8 * MAX_PAGE_BYTES / len(page)
    try:
        with replaced(path) as partial:
            partial.write_bytes(page)
    except OSError as error:
        raise ModelError(f"cannot write the page to '{path}': {error}") from error
    return Path(path)


def _note(runs: list[dict[str, Any]]) -> str:
    """Return a note on the numbers of logged and shown instants."""
    parts = [
        f"{run['name']}: {run['logged']} logged instants, {run['shown']} of them shown"
        for run in runs
    ]
    troubles = dict.fromkeys(
        t
        for run in runs
        for arm in run["truss"]["arms"]
        for t in arm["solid"]["troubles"]
    )
    drawn = f" Incomplete shapes: {'; '.join(troubles)}." if troubles else ""
    return f"{'; '.join(parts)}. The numbers in charts have four digits; the result files have all.{drawn}"


def _text(
    title: str, head: dict[str, Any], sections: Sequence[Section]
) -> str:
    return page_text(
        "trussflow.models.viewer",
        title,
        note=escape(_note(head["runs"])),
        scene=package_text("scene3d.js", "trussflow.models.viewer"),
        sections="".join(
            f"<section><h2>{escape(s.title)}</h2>{s.content}</section>\n"
            for s in sections
        ),
        head=compressed(script_json(head, allow_nan=False).encode()),
    )
