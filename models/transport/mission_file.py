"""Mission files: structure, robots, hardware, controller, path, simulation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from re import sub
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.control.trajectory import Trajectory
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Port
from trussflow.blocks.simulation.adaptive import METHODS
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.blocks.simulation.solver import FIXED_STEP
from trussflow.models.dynamics.task_space import moved
from trussflow.models.feasibility import survey
from trussflow.models.feasibility.failures import single_failures
from trussflow.models.feasibility.reach import RELATIVE_TOLERANCE
from trussflow.models.hardware.hardware import Hardware
from trussflow.models.hardware.measurement import derived_seed
from trussflow.models.hardware.motors import JointDrives
from trussflow.models.layered_file import LayeredFile, Told
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.parameter_files import ParameterTable, shipped_file
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.reporting.tables import text_table
from trussflow.models.transport.mean_axes_wiring import mean_axes_transport
from trussflow.models.transport.mission import FASTEST, Mission, case_file
from trussflow.models.transport.mission_path import path_from
from trussflow.models.transport.mission_plant import SWITCHES, plant_of, truth_of
from trussflow.models.transport.results import logged
from trussflow.models.transport.wiring import (
    ALLOCATIONS,
    CONTROLLERS,
    path_of,
    transport_diagram,
)
from trussflow.models.validation import check_number

MEAN_AXES = "mean axes"
"""Name of the mean-axes law; the other laws are those of the paper."""

HARDWARE_KINDS = ("none", "flight")
COMMON_SETTINGS = (("wheels", "gyroscopic"), ("joints", "control"))
"""Tables and keys of the hardware with the same value for all robots."""

COMMAND = "as called"
"""Place of settings that override the files."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionFile:
    """Content of a mission file.

    Attributes
    ----------
    title : str
        Title of the mission.
    mission : Mission
        Displacement, duration and gains.
    truss : SpaceTruss
        Plant.
    believed : SpaceTruss
        Nominal plant of the controller; it differs from the plant if the file has uncertainties.
    path : Trajectory or None
        Path if it differs from that of the mission.
    law : str
        ``"ismc"``, ``"smc"``, ``"pd"`` or ``"mean axes"``.
    observer : bool or None
        Argument of `transport_diagram`.
    allocation : str or None
        Argument of `transport_diagram`.
    design : MeanAxesDesign
        Design parameters of the mean-axes controller.
    hardware : Hardware or None
        Hardware between controller and truss.
    seed : int
        Seed of the sensor noise [-].
    duration : float
        Simulated time [s].
    solver : str
        Solver of `Simulator`.
    log_every : int
        Steps between logged instants [-].
    log : tuple of str
        Additional signals to log, see `Simulator`.
    rods : array, optional
        Lines in the picture of a user-defined structure, see `replay` [-].
    told : tuple of Told
        Used values with their files.
    """

    title: str
    mission: Mission
    truss: SpaceTruss
    believed: SpaceTruss
    path: Trajectory | None
    law: str
    observer: bool | None
    allocation: str | None
    design: MeanAxesDesign
    hardware: Hardware | None
    seed: int
    duration: float
    solver: str
    log_every: int
    log: tuple[str, ...]
    rods: NDArray[np.int_] | None
    told: tuple[Told, ...]

    @classmethod
    def read(cls, path: str | Path, /, **settings: Mapping[str, object]) -> MissionFile:
        """Read a mission file.

        Parameters
        ----------
        path : str or pathlib.Path
            TOML file, such as ``trussflow new mission.toml`` writes. Missing values are read from the file in
            its `extends`, by default ``parameters/transport.toml``.
        **settings : mapping
            Tables whose values override those of the file, such as ``controller={"law": "pd"}``.

        Raises
        ------
        ModelError
            If the file cannot be read, or has unknown, invalid or missing keys.
        """
        given = ParameterTable(
            {name: dict(table) for name, table in settings.items()}, COMMAND
        )
        return cls.of(LayeredFile.read(path, [given], "transport.toml"))

    @classmethod
    def of_case(cls, case: int, /, **settings: Mapping[str, object]) -> MissionFile:
        """Return a mission of the paper.

        Parameters
        ----------
        case : int
            Case 1 or 2 [-].
        **settings : mapping
            Tables that override the file, see `read`.
        """
        return cls.read(case_file(case), **settings)

    @classmethod
    def of(cls, file: LayeredFile) -> MissionFile:
        """Return the content of an opened file.

        Parameters
        ----------
        file : LayeredFile
            File with all tables of the shipped missions.

        Raises
        ------
        ModelError
            If a key is unknown, invalid or missing.
        """
        with file.blamed():
            return cls._of(file)

    @classmethod
    def _of(cls, file: LayeredFile) -> MissionFile:
        file.refuse_tables(_tables())
        controller, simulation = file.table("controller"), file.table("simulation")
        law = controller.choice("law", (*CONTROLLERS, MEAN_AXES))
        observer = SWITCHES[controller.choice("observer", SWITCHES)]
        allocation = controller.choice("allocation", ("auto", *ALLOCATIONS))
        kind = file.table("hardware").choice("kind", HARDWARE_KINDS)
        believed, rods = plant_of(file)
        stated = _hardware(file, believed)  # read even if unused, to find errors in it
        hardware = stated if kind == "flight" else None
        if hardware is not None:
            believed = hardware.mounted(believed)
        used = _used_by(law, observer, kind)
        mission = Mission.of(file, used)
        requested, way = mission.duration, file.table("path")
        limits = (hardware or Hardware.flight(control="torque")).limits(believed)
        mission, path = path_from(file, mission, believed, limits)
        refused = way.choice("infeasible", ("refused", "allowed")) == "refused"
        found = cls(
            title=file.named("title"),
            mission=mission,
            truss=truth_of(file, believed),
            believed=believed,
            path=path,
            law=law,
            observer=observer,
            allocation=None if allocation == "auto" else allocation,
            design=MeanAxesDesign.of(file),
            hardware=hardware,
            seed=file.table("hardware").whole("seed"),
            duration=simulation.scalar("duration", "s"),
            solver=simulation.choice("solver", (*FIXED_STEP, *METHODS)),
            log_every=simulation.whole("log_every"),
            log=tuple(simulation.texts("log")) if "log" in simulation else (),
            rods=rods,
            told=(),
        )
        file.refuse_others()
        check_number(
            "simulation",
            log_every=found.log_every,
            duration=found.duration,
            step=found.mission.step,
        )
        if law == MEAN_AXES and observer is not None:
            raise controller.error(
                "observer", "does not apply to the mean-axes law; omit it"
            )
        with file.blamed("hardware", "seed"):
            derived_seed(found.seed, 0)
        limited = hardware is not None or law == MEAN_AXES
        if refused and limited and requested < np.inf:
            with file.blamed("path", "duration"):
                least = found.least_duration()
            if least > mission.duration * (1.0 + RELATIVE_TOLERANCE):
                raise way.error(
                    "duration",
                    f"is {mission.duration:g} s, but the actuators need at least {least:.4g} s for this "
                    f"path; increase it, or set duration = {FASTEST!r} or infeasible = 'allowed'",
                )
        return replace(
            found,
            told=tuple(told for key, told in sorted(file.told.items()) if used(*key)),
        )

    def diagram(self) -> Diagram:
        """Return the diagram of the closed loop.

        Raises
        ------
        ModelError
            If parts are incompatible, such as hardware with another sample time than the controller.
        """
        both: dict[str, Any] = {
            "believed": self.believed.dynamics,
            "hardware": self.hardware,
            "seed": self.seed,
            "path": self.path,
        }
        if self.law == MEAN_AXES:
            return mean_axes_transport(
                self.mission, self.truss, design=self.design, **both
            )
        return transport_diagram(
            self.mission,
            self.truss,
            controller=self.law,
            observer=self.observer,
            allocation=self.allocation,
            **both,
        )

    def simulator(self, diagram: Diagram) -> Simulator:
        """Return a simulator of the loop that logs the signals of `logged`.

        Parameters
        ----------
        diagram : Diagram
            Diagram by `diagram`.
        """
        step = self.mission.step
        log: dict[str, Port | str] = {
            **logged(diagram),
            **{name: name for name in self.log},
        }
        return Simulator(
            diagram,
            step=step,
            solver=self.solver,
            log=log,
            log_step=self.log_every * step,
        )

    def said(self, key: str) -> str:
        """Return the value of a key as text, or the values of all robots.

        Parameters
        ----------
        key : str
            Table and key, such as ``"structure.model"``.
        """
        return ", ".join(
            told.value for told in self.told if sub(r"\[\d+\]", "", told.key) == key
        )

    @property
    def target(self) -> NDArray[np.float64]:
        """Task coordinates at the end of the path [m, unit of the attitude, rad]."""
        truss, way = self.truss, self.mission.displacement(self.truss.rigid)
        return np.asarray(moved(truss.dynamics.attitude, truss.start_position, way))

    def least_duration(self) -> float:
        """Return the shortest duration of the path within the actuator limits [s].

        Linear programmes compute it for the nominal plant and a path scaled in time; it is 0 for a path at
        rest. The limits are those of the hardware or, without hardware, of `Hardware.flight` with gearless joints.

        Raises
        ------
        ModelError
            If `survey` raises.
        """
        truss = self.believed
        limits = (self.hardware or Hardware.flight(control="torque")).limits(truss)
        if self.path is None and not np.any(self.mission.displacement(truss.rigid)):
            return 0.0
        path = path_of(self.mission, truss) if self.path is None else self.path
        healthy = single_failures(truss.dynamics)[:1]
        return survey(truss.dynamics, path, limits, healthy)[0].least_duration

    def explained(self) -> str:
        """Return all values with file and source, and the least duration of the path."""
        rows = [(told.key, told.value, told.place, told.source) for told in self.told]
        table = text_table(("key", "value", "file", "source"), rows)
        least = self.least_duration()
        bound = f"The actuators need at least {least:.4g} s for the path"
        return f"{self.title}\n\n{table}\n\n{bound}, which takes {self.mission.duration:g} s.{self.cut}"

    @property
    def cut(self) -> str:
        """Remark if the simulation ends before the path; otherwise empty."""
        short = self.duration < self.mission.duration
        return (
            f" Only {self.duration:g} s are simulated, by simulation.duration."
            if short
            else ""
        )


@cache
def _tables() -> frozenset[str]:
    """Return the tables and top-level keys that a mission file may have."""
    shipped = LayeredFile.read(shipped_file("new_mission.toml"))
    return frozenset(
        {"uncertainties"}.union(*(layer.content for layer in shipped.layers))
    )


def _used_by(
    law: str, observer: bool | None, hardware: str
) -> Callable[[str, str], bool]:
    """Return a function of table and key for whether the mission uses it."""
    sliding, flies = law in ("ismc", "smc"), hardware != "none"
    used = {
        "allocation": law in CONTROLLERS,
        "sliding_mode": law == "ismc",
        "conventional_sliding_mode": law == "smc",
        "proportional_derivative": law == "pd",
        "controller.allocation": sliding,
        "controller.observer": sliding,
        "controller.observer_bandwidth": sliding
        and (law == "ismc" if observer is None else observer),
        "controller.reaching_gain": law == "ismc",
        "hardware.seed": flies,
        **dict.fromkeys(
            ParameterTable.shipped("mean_axes.toml").content, law == MEAN_AXES
        ),
        **dict.fromkeys(ParameterTable.shipped("hardware.toml").content, flies),
    }
    return lambda table, key: (
        used.get(table.rpartition(".")[2], True) and used.get(f"{table}.{key}", True)
    )


def _hardware(file: LayeredFile, truss: SpaceTruss) -> Hardware:
    """Return the hardware of a file; tables of a robot override it for that robot."""
    stated, each = Hardware.of(file), []
    drives: list[dict[str, Any]] = []
    for arm, robot in zip(
        truss.dynamics.arms, file.elements("robots", truss.robots), strict=True
    ):
        own = file.within(robot.name, "thrusters", "wheels", "joints", "drives")
        each.append(Hardware.of(own))
        values = each[-1].drives.keywords.items()
        drives.append({name: np.full(arm.joints, value) for name, value in values})
        for table, key in COMMON_SETTINGS:
            if own.table(table).text(key) != file.table(table).text(key):
                raise own.table(table).error(
                    key, f"must be equal for all robots; set it in [{table}]"
                )
    if not any("." in table for table, _ in file.told):
        return stated
    parts: dict[str, Any] = {
        name: tuple(getattr(h, name) for h in each) for name in ("thrusters", "wheels")
    }
    joined: dict[str, Any] = {
        name: np.concatenate([each[name] for each in drives]) for name in drives[0]
    }
    return replace(stated, drives=partial(JointDrives, **joined), **parts)
