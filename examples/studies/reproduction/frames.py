"""Figures 1 and 2 of the paper: the system, and the frames of one robot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trussflow.blocks.support.types import Vector
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.reporting.figures import save
from trussflow.models.viewer.scene import frame_rods

AXES = {"x": "#d62728", "y": "#2ca02c", "z": "#1f77b4"}


def link_frames(truss: SpaceTruss, robot: int) -> list[tuple[Vector, Vector]]:
    r"""Return origin [m] and axes of the frames :math:`O_{i,0}` to :math:`O_{i,7}` and :math:`O_{ci}`.

    The coordinates are those of the truss frame :math:`O_t`, with all joint angles zero.
    The rotations are those of Table 2, the chain is that of Eq. 36.

    Parameters
    ----------
    truss : SpaceTruss
        Plant with undeformed truss.
    robot : int
        Number of the robot, from 1 [-].
    """
    arm = truss.dynamics.arms[robot - 1]
    place = truss.dynamics.modes.grasp_positions[robot - 1]
    axes = arm.hand_rotation
    frames = [(place, axes)]
    for origin, rotation in zip(arm.joint_origins, arm.joint_rotations, strict=True):
        place, axes = place + axes @ origin, axes @ rotation
        frames.append((place, axes))
    frames.append((place + axes @ arm.base_position, axes @ arm.base_rotation))
    return frames


def _draw_frame(plot: Any, origin: Vector, axes: Vector, size: float) -> None:
    for (letter, colour), axis in zip(AXES.items(), axes.T, strict=True):
        plot.plot(*np.stack([origin, origin + size * axis]).T, color=colour)
        plot.text(*(origin + 1.2 * size * axis), letter, color=colour, fontsize="small")


def _space(title: str) -> tuple[Figure, Any]:
    figure = Figure(figsize=(7.0, 5.0), layout="constrained")
    plot = figure.add_subplot(projection="3d", proj_type="ortho")
    plot.set_title(title, loc="left", fontsize="medium")
    plot.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    return figure, plot


def draw_frames(folder: Path) -> None:
    """Draw the plant of the paper at its initial state, and Robot 4 alone.

    Parameters
    ----------
    folder : pathlib.Path
        Folder of ``figure-01.png`` and ``figure-02.png``.
    """
    truss = SpaceTruss.published()
    modes = truss.dynamics.modes
    figure, plot = _space("Truss, four robots, and the inertial and truss frames")
    for rod in modes.positions[frame_rods(modes)]:
        plot.plot(*rod.T, color="#5a6b7b", linewidth=1.0)
    for robot in range(1, len(truss.dynamics.arms) + 1):
        origins = np.array([origin for origin, _ in link_frames(truss, robot)])
        plot.plot(*origins.T, linewidth=2.5, label=f"Robot {robot}")
        plot.scatter(*origins[-1], marker="s", s=60.0)
    for origin, name in ((np.full(3, -1.5), "$O_e$"), (np.zeros(3), "$O_t$")):
        _draw_frame(plot, origin, np.eye(3), 1.5)
        plot.text(*(origin - 0.7), name)
    plot.legend(fontsize="small", frameon=False)
    plot.set_aspect("equal")
    save(figure, folder / "figure-01.png", small=True)

    figure, plot = _space("Frames of Robot 4, all joint angles zero")
    frames = link_frames(truss, 4)
    plot.plot(*np.array([origin for origin, _ in frames]).T, color="0.6", linewidth=4.0)
    names: dict[tuple[float, ...], list[str]] = {}
    for k, (origin, axes) in enumerate(frames):
        _draw_frame(plot, origin, axes, 0.05)
        name = f"O_{{4,{k}}}" if k < len(frames) - 1 else "O_{c4}"
        names.setdefault(tuple(origin.round(3)), []).append(name)
    for place, here in names.items():
        plot.text(place[0], place[1] + 0.07, place[2] + 0.02, f"${', '.join(here)}$")
    plot.set_yticks([frames[0][0][1].round(3)])
    plot.view_init(elev=15.0, azim=-70.0)
    plot.set_aspect("equal")
    save(figure, folder / "figure-02.png", small=True)
