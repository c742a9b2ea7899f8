"""Plant of a mission file: a structure of the paper or a user-defined one, and robots."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.geometry.attitude import ATTITUDES, QUATERNION
from trussflow.models.geometry.rotation import fixed_rotation
from trussflow.models.layered_file import LayeredFile, LayeredTable
from trussflow.models.plant.space_truss import ARMS, STRUCTURES, SpaceTruss, arm_by_name
from trussflow.models.robots.robot_arm import RobotArm
from trussflow.models.truss.frame import Frame
from trussflow.models.truss.nastran import structure_from_nastran
from trussflow.models.truss.reduction import reduced_modes
from trussflow.models.truss.structure import Structure
from trussflow.models.truss.variations import loaded, scaled
from trussflow.models.validation import check_number

FRAME, NASTRAN, MATRICES = "frame", "nastran", "matrices"
"""Kinds of user-defined structures."""

URDF = ".urdf"

SWITCHES: Mapping[str, bool | None] = {"auto": None, "on": True, "off": False}


def plant_of(file: LayeredFile) -> tuple[SpaceTruss, NDArray[np.int_] | None]:
    """Return the nominal plant of a file, and the rods of a user-defined structure.

    The model has defaults for missing keys.

    Parameters
    ----------
    file : LayeredFile
        File with the tables ``[structure]`` and ``[robots]``.

    Raises
    ------
    ModelError
        If a file in them cannot be read, or the parts are incompatible.
    """
    structure, folder = file.table("structure"), file.folder
    model = structure.choice("model", (*STRUCTURES, FRAME, NASTRAN, MATRICES))
    modes = {"modes": structure.whole("modes")} if "modes" in structure else {}
    damping = structure.optional(damping="1")
    if model == "published" and damping:
        raise structure.error(
            "damping",
            "does not apply to the undamped published model; choose another model",
        )
    blamed = structure.file.blamed
    if model in STRUCTURES:
        with blamed("structure", "model"):
            truss, rods = getattr(SpaceTruss, model)(**modes, **damping), None
        dynamics = replace(truss.dynamics, arms=_arms(file, truss.robots))
        truss = SpaceTruss(dynamics, modal_actuation=truss.modal_actuation)
    else:
        held = structure.rows("grasps")
        uses = Counter(node for nodes in held for node in {*nodes})
        if shared := [node for node, robots in uses.items() if robots > 1]:
            raise structure.error("grasps", f"gives node {shared[0]} to two robots")
        grasps = [set(nodes) if len(nodes) > 1 else nodes[0] for nodes in held]
        with blamed("structure", "stiffness" if model == MATRICES else "file"):
            body = _structure(model, structure, folder)
        with blamed("structure", "grasps"):
            flexible = reduced_modes(
                body, modes.get("modes", 6), grasps, **_shapes(structure)
            )
            flexible = flexible.damped(damping.get("damping", 0.0))
        arms = _arms(file, len(grasps))
        dynamics = TrussDynamics(modes=flexible, arms=arms, elastic_integrals=True)
        truss, rods = SpaceTruss(dynamics), body.rods(flexible.positions)
    if "start_attitude" in structure:
        truss = truss.turned(structure.array("start_attitude", "rad", (3,)))
    if structure.choice("attitude", ATTITUDES) == QUATERNION.name:
        truss = truss.with_quaternion()
    return truss, rods


def truth_of(file: LayeredFile, believed: SpaceTruss) -> SpaceTruss:
    """Return the plant of the simulation: a Monte Carlo sample of the uncertain nominal plant.

    Samples are uniform within ±`mass` and ±`frequency` of the nominal values, within the bounds of `damping`,
    and from zero to `payload`, at the point farthest from the truss frame. Sample 0 is the nominal plant.

    Parameters
    ----------
    file : LayeredFile
        File with the table ``[uncertainties]``.
    believed : SpaceTruss
        Nominal plant by `plant_of`.

    Raises
    ------
    ModelError
        If a value of the table is invalid.
    """
    table, modes = file.table("uncertainties"), believed.dynamics.modes
    given = table.optional(mass="1", frequency="1", payload="kg")
    damping = table.array("damping", "1", (2,)) if "damping" in table else None
    draw = table.whole("draw") if "draw" in table else None
    for key, value in given.items():
        if value < 0.0 or (key != "payload" and value >= 1.0):
            below = "" if key == "payload" else " and below 1"
            raise table.error(key, f"is {value:g}; it must be at least 0{below}")
    if damping is not None and not 0.0 <= damping[0] <= damping[1] < 1.0:
        raise table.error(
            "damping", "must be a lower and an upper bound, from 0 to below 1"
        )
    if draw is None and (given or damping is not None):
        raise table.error(
            next(iter([*given, "damping"])),
            "has no effect without a sample: set draw = 1",
        )
    if draw is not None and draw < 0:
        raise table.error("draw", f"is {draw}; it must be 0 (nominal) or above")
    if not draw:
        return believed
    # There are always four random numbers, so that samples do not depend on which keys are given.
    *chances, loading, damped = np.random.default_rng(draw).uniform(size=4)
    factors = {
        key: 1.0 + given.get(key, 0.0) * (2.0 * chance - 1.0)
        for key, chance in zip(("mass", "frequency"), chances, strict=True)
    }
    far = modes.positions[np.argmax(np.linalg.norm(modes.positions, axis=1))]
    varied = loaded(
        scaled(modes.damped(0.0), **factors), far, loading * given.get("payload", 0.0)
    )
    if damping is None:
        varied = replace(varied, damping_ratios=modes.damping_ratios)
    else:
        varied = varied.damped(damping[0] + damped * (damping[1] - damping[0]))
    return believed.changed(dynamics=replace(believed.dynamics, modes=varied))


def _structure(model: str, table: LayeredTable, folder: Path) -> Structure:
    """Return a user-defined structure."""
    if model == MATRICES:
        keys = ("mass", "stiffness", "positions")
        mass, stiffness, positions = (folder / table.text(key) for key in keys)
        return Structure.from_matrices(
            mass,
            stiffness,
            positions,
            units=table.texts("units"),
            source=stiffness.name,
        )
    file = folder / table.text("file")
    if model == FRAME:
        return Frame.from_file(file).structure()
    matrices = folder / table.text("matrices")
    return structure_from_nastran(file, matrices, units=table.texts("units"))


def _shapes(table: LayeredTable) -> dict[str, Any]:
    """Return the arguments of `reduced_modes` for attachment shapes."""
    found: dict[str, Any] = table.optional(highest_frequency="Hz")
    if "attachments" in table:
        found["attachments"] = SWITCHES[table.choice("attachments", ("on", "off"))]
    return found


def _arms(file: LayeredFile, count: int) -> tuple[RobotArm, ...]:
    """Return the robots of `count` grasps."""
    tables, arms = file.elements("robots", count), {}
    for table in tables:
        if table.name not in arms:
            with file.blamed(table.name, "arm"):
                arms[table.name] = _arm(table, file.folder)
    return tuple(arms[table.name] for table in tables)


def _arm(robot: LayeredTable, folder: Path) -> RobotArm:
    """Return the robot of a table."""
    name = robot.text("arm")
    kind = Path(name).suffix.lower()
    if name in ARMS:
        arm = arm_by_name(name)
    elif kind == ".toml":
        arm = RobotArm.from_file(folder / name)
    elif kind == URDF:
        locked = robot.mapping("locked") if "locked" in robot else {}
        if not all(isinstance(place, str) for place in locked.values()):
            raise robot.error(
                "locked",
                "must give each joint a coordinate with its unit, such as {finger = '0.04 m'}",
            )
        arm = RobotArm.from_urdf(
            folder / name,
            hand=robot.text("hand"),
            base=robot.text("base"),
            locked=locked,
        )
    else:
        choices = ", ".join((*ARMS, "FILE.urdf", "FILE.toml"))
        raise robot.error("arm", f"is {name!r}; choose from: {choices}")
    for key in ("hand", "base", "locked"):
        # An arm of the command line replaces a URDF file of the mission file, and its links with it.
        given, arm_given = robot.owner(key), robot.owner("arm")
        if key in robot and kind != URDF and given.place == arm_given.place:
            raise robot.error(
                key, f"applies to a URDF file only, and the arm is {name!r}; omit it"
            )
    if "rotation" in robot:
        turn = fixed_rotation(robot.array("rotation", "rad", (3,)))
        arm = replace(arm, hand_rotation=turn @ arm.hand_rotation)
    if "bus_mass" in robot:
        mass = robot.scalar("bus_mass", "kg")
        check_number("robot", bus_mass=mass)
        arm = replace(
            arm, base_mass=mass, base_inertia=arm.base_inertia * (mass / arm.base_mass)
        )
    return arm
