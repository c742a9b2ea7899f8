"""The scene as a panel of a page that simulates."""

from __future__ import annotations

import numpy.typing as npt

from trussflow.blocks.live.page import Panel
from trussflow.blocks.support.texts import package_text, script_json
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.viewer.scene import scene_of, target_of


def scene_panel(
    truss: SpaceTruss,
    path: str = "truss",
    *,
    rods: npt.ArrayLike | None = None,
    target: npt.ArrayLike | None = None,
) -> Panel:
    """Return the scene of a truss as a panel.

    Parameters
    ----------
    truss : SpaceTruss
        Plant.
    path : str
        Path of its block in the diagram.
    rods : array_like, shape (k, 2), optional
        Pairs of point masses connected by a rod [-]; required except for the shipped trusses.
    target : array_like, optional
        Task coordinates of the target pose, drawn transparently [m, rad].

    Raises
    ------
    ModelError
        If rods are required but not given, or the target has another size.
    """
    names = [f"{path}.{port}" for port in ("coordinates", "base_force", "base_torque")]
    data = {
        "truss": scene_of(truss, rods),
        "names": names,
        "ends": [truss.dynamics.attitude.end, truss.rigid_q],
        "start": truss.parameters["initial_coordinates"].tolist(),
        "target": target_of(truss, target),
    }
    text = script_json(script_json(data, allow_nan=False))
    return Panel(
        package_text("scene3d.js", "trussflow.models.viewer")
        + f"\nwindow.trussflowPanels.push(Scene3d.panel(JSON.parse({text}, unpacked)));\n",
        tuple(names),
    )
