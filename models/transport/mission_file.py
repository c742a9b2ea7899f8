"""Missions as files: structure, robots, hardware, controller, path, and how long to fly."""

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
from trussflow.models.feasibility import ActuatorLimits, survey
from trussflow.models.feasibility.failures import single_failures
from trussflow.models.feasibility.reach import EXACT
from trussflow.models.hardware.hardware import Hardware
from trussflow.models.hardware.measurement import derived_seed
from trussflow.models.hardware.motors import JointDrives
from trussflow.models.layered_file import LayeredFile, Told
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.parameter_files import ParameterTable, shipped_file
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.reporting.tables import text_table
from trussflow.models.transport.logged_ports import logged
from trussflow.models.transport.mean_axes_wiring import mean_axes_transport
from trussflow.models.transport.mission import CASES, FASTEST, Mission
from trussflow.models.transport.mission_path import path_from
from trussflow.models.transport.mission_plant import SWITCHES, plant_of, truth_of
from trussflow.models.transport.wiring import ALLOCATIONS, CONTROLLERS, path_of, transport_diagram
from trussflow.models.validation import check_choice, check_number

MEAN_AXES = "mean axes"
"""The law that flies accurate structures behind hardware; the others are of the source."""

HARDWARE = ("none", "flight")
COMMAND = "as called"
"""Where settings come from that count more than any file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionFile:
    """What a mission file says.

    Attributes
    ----------
    title : str
        For people.
    mission : Mission
        Path and gains.
    truss : SpaceTruss
        The plant.
    believed : SpaceTruss
        What the controller takes it for; another one where the file draws what is uncertain.
    path : Trajectory or None
        Where it differs from the mission's own.
    law : str
        ``"ismc"``, ``"smc"``, ``"pd"`` or ``"mean axes"``.
    observer : bool or None
        As of `transport_diagram`.
    allocation : str or None
        Likewise.
    design : MeanAxesDesign
        Of the mean axes.
    hardware : Hardware or None
        Between controller and truss.
    seed : int
        Of the sensors' noise [-].
    duration : float
        To simulate [s].
    solver : str
        Of `Simulator`.
    log_every : int
        Steps between logged instants [-].
    log : tuple of str
        What to log besides what `tidy` and the pages need; as of `Simulator`.
    rods : array, optional
        Of the picture of a structure of one's own; see `replay` [-].
    told : tuple of Told
        Every value that is used, and the file that says so.
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
            TOML, as ``trussflow new mission.toml`` writes it. What it leaves out is as in the file that its
            `extends` names, by default ``parameters/transport.toml``.
        **settings : mapping
            Tables whose values count more than the file's, such as ``controller={"law": "pd"}``.

        Raises
        ------
        ModelError
            If the file cannot be read, says what means nothing, or leaves out what is needed.
        """
        given = ParameterTable({name: dict(table) for name, table in settings.items()}, COMMAND)
        return cls.of(LayeredFile.read(path, [given], "transport.toml"))

    @classmethod
    def of_case(cls, case: int, /, **settings: Mapping[str, object]) -> MissionFile:
        """Return a mission of the source.

        Parameters
        ----------
        case : int
            1 or 2.
        **settings : mapping
            As of `read`.
        """
        check_choice("transport case", case, CASES)
        return cls.read(shipped_file(f"case_{case}.toml"), **settings)

    @classmethod
    def of(cls, file: LayeredFile) -> MissionFile:
        """Return what an opened file says.

        Parameters
        ----------
        file : LayeredFile
            With all tables of the shipped missions.

        Raises
        ------
        ModelError
            As of `read`.
        """
        with file.blamed():
            return cls._of(file)

    @classmethod
    def _of(cls, file: LayeredFile) -> MissionFile:
        file.refuse_tables(_tables())
        controller, simulation = file.table("controller"), file.table("simulation")
        shipped = [f"case_{case}.toml" for case in CASES]
        named = [layer.place for layer in file.layers]
        own = next((n for n in named if n != COMMAND), "")
        law = controller.choice("law", (*CONTROLLERS, MEAN_AXES))
        observer = SWITCHES[controller.choice("observer", SWITCHES)]
        allocation = controller.choice("allocation", ("auto", *ALLOCATIONS))
        kind = file.table("hardware").choice("kind", HARDWARE)
        believed, rods = plant_of(file)
        stated = _hardware(file, believed)  # read whether it flies or not, so that slips in it are found
        hardware = stated if kind == "flight" else None
        used = _used_by(law, observer, kind)
        mission = Mission.of(file, CASES[shipped.index(own)] if own in shipped else None, used)
        requested, way = mission.duration, file.table("path")
        mission, path = path_from(file, mission, believed, _limits(believed, hardware))
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
            "simulation", log_every=found.log_every, duration=found.duration, step=found.mission.step
        )
        if law == MEAN_AXES and observer is not None:
            raise controller.error(
                "observer", "is not for the mean axes, which have none to switch; leave it out"
            )
        with file.blamed("hardware", "seed"):
            derived_seed(found.seed, 0)
        limited = hardware is not None or law == MEAN_AXES
        if refused and limited and requested < np.inf:
            with file.blamed("path", "duration"):
                least = found.least_duration()
            if least > mission.duration * (1.0 + EXACT):
                raise way.error(
                    "duration",
                    f"is {mission.duration:g} s, but the actuators need at least {least:.4g} s for this "
                    f"path; give it that time, or say duration = {FASTEST!r}, or infeasible = 'allowed'",
                )
        return replace(found, told=tuple(told for key, told in sorted(file.told.items()) if used(*key)))

    def diagram(self) -> Diagram:
        """Return the loop, wired.

        Raises
        ------
        ModelError
            If the parts do not go together, such as hardware of another sample time than the controller's.
        """
        both: dict[str, Any] = {
            "believed": self.believed.dynamics,
            "hardware": self.hardware,
            "seed": self.seed,
            "path": self.path,
        }
        if self.law == MEAN_AXES:
            return mean_axes_transport(self.mission, self.truss, design=self.design, **both)
        return transport_diagram(
            self.mission,
            self.truss,
            controller=self.law,
            observer=self.observer,
            allocation=self.allocation,
            **both,
        )

    def simulator(self, diagram: Diagram) -> Simulator:
        """Return a simulator of the loop that logs what `tidy` and the pages need.

        Parameters
        ----------
        diagram : Diagram
            From `diagram`.
        """
        step = self.mission.step
        log: dict[str, Port | str] = {**logged(diagram), **{name: name for name in self.log}}
        return Simulator(diagram, step=step, solver=self.solver, log=log, log_step=self.log_every * step)

    def said(self, key: str) -> str:
        """Return the value of a key as it was read; of a key of several robots, their values.

        Parameters
        ----------
        key : str
            Such as ``"structure.model"``.
        """
        return ", ".join(told.value for told in self.told if sub(r"\[\d+\]", "", told.key) == key)

    @property
    def target(self) -> NDArray[np.float64]:
        """The task coordinates at the end of the path [m, unit of the attitude, rad]."""
        truss, way = self.truss, self.mission.displacement(self.truss.rigid)
        start = truss.parameters["initial_coordinates"][: truss.rigid_q]
        return np.asarray(moved(truss.dynamics.attitude, start, way))

    def least_duration(self) -> float:
        """Return the shortest duration of the path with which the actuators keep their limits [s].

        By linear programmes, for the truss that is believed and the path slowed down or sped up as a whole; 0
        for a path that rests. The limits are those of the hardware; without, of `ActuatorLimits.flight`.

        Raises
        ------
        ModelError
            As of `survey`.
        """
        truss, limits = self.believed, _limits(self.believed, self.hardware)
        if self.path is None and not np.any(self.mission.displacement(truss.rigid)):
            return 0.0
        path = path_of(self.mission, truss) if self.path is None else self.path
        healthy = single_failures(truss.dynamics)[:1]
        return survey(truss.dynamics, path, limits, healthy)[0].least_duration

    def explained(self) -> str:
        """Return every value, where it comes from and its source, and the least duration of the path."""
        rows = [(told.key, told.value, told.place, told.source) for told in self.told]
        table = text_table(("what", "value", "said by", "source"), rows)
        least = self.least_duration()
        bound = f"The actuators need at least {least:.4g} s for the path"
        arms = self.truss.dynamics.arms
        missing = dict.fromkeys((a.name, v.trouble) for a in arms for v in a.visuals if v.trouble)
        undrawn = "".join(f"\nThe picture of {name} leaves out {trouble}." for name, trouble in missing)
        return (
            f"{self.title}\n\n{table}\n\n{bound}, which takes {self.mission.duration:g} s.{self.cut}{undrawn}"
        )

    @property
    def cut(self) -> str:
        """What to say if the flight ends before its path does; otherwise empty."""
        short = self.duration < self.mission.duration
        return f" Only {self.duration:g} s are flown: the duration of the simulation." if short else ""


@cache
def _tables() -> frozenset[str]:
    """Return the tables and top-level keys that a mission file may have."""
    shipped = LayeredFile.read(shipped_file("new_mission.toml"))
    return frozenset({"uncertainties"}.union(*(layer.content for layer in shipped.layers)))


def _used_by(law: str, observer: bool | None, hardware: str) -> Callable[[str, str], bool]:
    """Return whether a mission uses a key of a table, by its law, observer and kind of hardware."""
    sliding, flies = law in ("ismc", "smc"), hardware != "none"
    used = {
        "allocation": law in CONTROLLERS,
        "sliding_mode": law == "ismc",
        "conventional_sliding_mode": law == "smc",
        "proportional_derivative": law == "pd",
        "controller.allocation": sliding,
        "controller.observer": sliding,
        "controller.observer_bandwidth": sliding and (law == "ismc" if observer is None else observer),
        "controller.reaching_gain": law == "ismc",
        "hardware.seed": flies,
        **dict.fromkeys(ParameterTable.shipped("mean_axes.toml").content, law == MEAN_AXES),
        **dict.fromkeys(ParameterTable.shipped("hardware.toml").content, flies),
    }
    return lambda table, key: used.get(table.rpartition(".")[2], True) and used.get(f"{table}.{key}", True)


def _hardware(file: LayeredFile, truss: SpaceTruss) -> Hardware:
    """Return the hardware of a file; tables of a robot count more for what that robot carries."""
    stated, each, torques = Hardware.of(file), [], []
    for arm, robot in zip(truss.dynamics.arms, file.elements("robots", truss.robots), strict=True):
        own = file.within(robot.name, "thrusters", "wheels", "joints")
        each.append(Hardware.of(own))
        torques += [own.table("joints").scalar("torque", "N*m")] * arm.joints
        if each[-1].gyroscopic != stated.gyroscopic:
            raise own.table("wheels").error("gyroscopic", "is for all robots; say it in [wheels]")
    if not any("." in table for table, _ in file.told):
        return stated
    parts: dict[str, Any] = {name: tuple(getattr(h, name) for h in each) for name in ("thrusters", "wheels")}
    return replace(stated, drives=partial(JointDrives, torque=torques), **parts)


def _limits(truss: SpaceTruss, hardware: Hardware | None) -> ActuatorLimits:
    """Return the limits of the hardware; without, those of `ActuatorLimits.flight`."""
    if hardware is None:
        return ActuatorLimits.flight()
    each = hardware.limits(truss)
    bases, joints = each[: 6 * truss.robots].reshape(-1, 6), each[6 * truss.robots :]
    return ActuatorLimits(force=bases[:, :3], base_torque=bases[:, 3:], joint_torque=joints)
