"""Frames of a robot, as in Figure 2 of the paper."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trussflow.blocks.support.types import Vector
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.reporting.figures import save

AXIS_LENGTH = 0.05  # m
AXES = {"x": "#d62728", "y": "#2ca02c", "z": "#1f77b4"}


def link_frames(dynamics: TrussDynamics, robot: int) -> list[tuple[Vector, Vector]]:
    r"""Return origin [m] and axes of the frames :math:`O_{i,0}` to :math:`O_{i,7}` and :math:`O_{ci}`.

    The coordinates are those of the truss frame :math:`O_t`, with all joint angles zero.
    The rotations are those of Table 2, the chain is that of Eq. 36.

    Parameters
    ----------
    dynamics : TrussDynamics
        Equations of motion of the truss, which is not deformed.
    robot : int
        Number of the robot, from 1 [-].
    """
    arm = dynamics.arms[robot - 1]
    place = dynamics.modes.grasp_positions[robot - 1]
    axes = arm.hand_rotation
    frames = [(place, axes)]
    for origin, rotation in zip(arm.joint_origins, arm.joint_rotations, strict=True):
        place, axes = place + axes @ origin, axes @ rotation
        frames.append((place, axes))
    frames.append((place + axes @ arm.base_position, axes @ arm.base_rotation))
    return frames


def draw_frames(file: Path) -> None:
    """Draw the frames of Robot 4 with all joint angles zero.

    Parameters
    ----------
    file : pathlib.Path
        PNG file.
    """
    figure = Figure(figsize=(7.0, 5.0), layout="constrained")
    plot: Any = figure.add_subplot(projection="3d", proj_type="ortho")
    frames = link_frames(SpaceTruss.published().dynamics, 4)
    plot.plot(*np.array([origin for origin, _ in frames]).T, color="0.6", linewidth=4.0)
    names: dict[tuple[float, ...], list[str]] = {}
    for k, (origin, axes) in enumerate(frames):
        for (letter, colour), axis in zip(AXES.items(), axes.T, strict=True):
            end = origin + AXIS_LENGTH * axis
            plot.plot(*np.stack([origin, end]).T, color=colour)
            plot.text(*end, letter, color=colour, fontsize="small")
        name = f"O_{{4,{k}}}" if k < len(frames) - 1 else "O_{c4}"
        names.setdefault(tuple(origin.round(3)), []).append(name)
    for (x, y, z), here in names.items():
        plot.text(x, y + 0.07, z + 0.02, f"${', '.join(here)}$")
    plot.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]", yticks=[round(y, 3)])
    plot.view_init(elev=15.0, azim=-70.0)
    plot.set_aspect("equal")
    save(figure, file, small=True)
