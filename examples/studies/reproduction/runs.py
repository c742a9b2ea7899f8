"""The missions that the report flies."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from study_tools.cache import Work, inputs_of

from reproduction.trusses import PRINTED_MODES, truss_modes
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.models.plant.space_truss import SpaceTruss, arm_by_name
from trussflow.models.transport.mission import CASES, Mission
from trussflow.models.transport.results import logged
from trussflow.models.transport.wiring import transport_diagram

LOG_STEP, FINE_LOG_STEP = 0.01, 0.005
"""Time between logged instants [s]. A law that switches does so at every step of 1 ms; its ripple
is seen only if an odd number of steps lies between logged instants."""

FINE_STEP = 1e-4  # s
"""A tenth of the source's step."""

STIFF_SOLVER = "LSODA"
"""For PD, whose fastest pole is near 1e7 1/s."""

MOUNTING = 0.15675
"""From the arm's last joint to its mounting plane: joint 1 of the Kinova description [m]."""

PUSH = 0.05
"""Speed along z at which a pushed run starts [m/s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionRun:
    """One mission, and what is different about it; without options it is the source's.

    Attributes
    ----------
    name : str
        Unique in the report.
    case : int
        1 or 2.
    duration : float
        Simulated time [s].
    plant : str
        ``"published"`` or ``"consistent"``.
    controller : str
        ``"ismc"``, ``"smc"`` or ``"pd"``.
    observer : bool, optional
        By default beside ismc only.
    arm : str
        ``"literal"`` or ``"jaco"``.
    truss : str
        One of `reproduction.trusses.VARIANTS`.
    modes : int
        Number of flexible modes [-].
    base_offset : float
        Added to the base's place, along z of the last link [m].
    boundary_layer : float, optional
        iota, if not the source's [unit/s].
    equal_weights : bool
        Allocate with W = I.
    pushed : bool
        Start with a speed of `PUSH` along z instead of at rest.
    log_step : float
        Time between logged instants [s].
    step : float, optional
        Of the fixed-step solver, if not the source's [s].
    """

    name: str
    case: int
    duration: float
    plant: str = "published"
    controller: str = "ismc"
    observer: bool | None = None
    arm: str = "literal"
    truss: str = "reconstructed"
    modes: int = PRINTED_MODES
    base_offset: float = 0.0
    boundary_layer: float | None = None
    equal_weights: bool = False
    pushed: bool = False
    log_step: float = LOG_STEP
    step: float | None = None

    def options(self) -> dict[str, Any]:
        """Return what is different from the source's mission, for people."""
        plain = MissionRun(name=self.name, case=self.case, duration=self.duration)
        usual = asdict(replace(plain, log_step=self.log_step))
        return {k: v for k, v in asdict(self).items() if v != usual[k]}

    def mission(self) -> Mission:
        """Return the mission with its gains."""
        mission = Mission.of_case(self.case)
        if self.boundary_layer is not None:
            mission = replace(mission, boundary_layer=self.boundary_layer)
        if self.equal_weights:
            mission = replace(mission, weights=np.ones(6), joint_weight=1.0)
        return mission

    def space_truss(self, folder: Path) -> SpaceTruss:
        """Return the plant.

        Parameters
        ----------
        folder : pathlib.Path
            Where computed modes are kept.
        """
        usual: SpaceTruss = getattr(SpaceTruss, self.plant)(arm=self.arm)
        ratio = float(usual.dynamics.modes.damping_ratios[0])
        modes = truss_modes(self.truss, self.modes, folder).damped(ratio)
        arm = arm_by_name(self.arm)
        arm = replace(arm, base_origin=arm.base_origin + np.array([0.0, 0.0, self.base_offset]))
        dynamics = replace(usual.dynamics, modes=modes, arms=(arm,) * modes.grasps)
        return SpaceTruss(dynamics, modal_actuation=usual.modal_actuation)

    def work(self, folder: Path) -> Work:
        """Make the run ready.

        Parameters
        ----------
        folder : pathlib.Path
            Where computed modes are kept.
        """
        mission, truss = self.mission(), self.space_truss(folder)
        diagram = transport_diagram(mission, truss, controller=self.controller, observer=self.observer)
        simulator = Simulator(
            diagram,
            step=self.step or mission.step,
            log=logged(diagram),
            log_step=self.log_step,
            solver=STIFF_SOLVER if self.controller == "pd" else "rk4",
        )
        initial: dict[str, Any] = {}
        if self.pushed:
            speeds = np.zeros(truss.n)
            speeds[2] = PUSH
            initial["truss.v"] = speeds

        def compute() -> xr.Dataset:
            result = simulator.run(self.duration, initial=initial, progress=False)
            return result.assign_attrs(observer=int("observer" in diagram.blocks))

        return Work(inputs_of(simulator, self.duration, initial), compute)


# The law without its boundary layer (Eq. 54); the block wants it positive.
SWITCHING = {"boundary_layer": 1e-12}

FINELY_LOGGED: dict[str, dict[str, Any]] = {
    # behind the source's figures
    "": {},
    "-no-observer": {"observer": False},
    "-smc": {"controller": "smc"},
    "-pd": {"controller": "pd"},
    # for the claims besides
    "-switching": SWITCHING,
    "-switching-no-observer": {**SWITCHING, "observer": False},
    "-smc-observer": {"controller": "smc", "observer": True},
    "-fine": {"step": FINE_STEP},
    "-smc-fine": {"controller": "smc", "step": FINE_STEP},
    "-equal-weights": {"equal_weights": True},
    "-consistent": {"plant": "consistent"},
}
"""What is different from the source's mission in the runs that ripple is measured on."""

OTHERS: dict[str, dict[str, Any]] = {
    # far from rest, for Theorem 2
    "-pushed": {"pushed": True},
    # held for long after the mission, for the late errors
    "-long": {},
    # each assumption changed
    "-centroid-at-joint": {"base_offset": -0.125},
    "-half-mounting": {"base_offset": MOUNTING / 2},
    "-mounting": {"base_offset": MOUNTING},
    "-other-side": {"truss": "other side"},
    "-inner-edge": {"truss": "inner edge"},
    "-jaco": {"arm": "jaco"},
    "-jaco-at-joint": {"arm": "jaco", "base_offset": -MOUNTING},
    "-rigid": {"modes": 0},
    "-2-modes": {"modes": 2},
    "-12-modes": {"modes": 12},
    "-20-modes": {"modes": 20},
}
"""What is different in all other runs."""


def all_missions(duration: float) -> dict[str, MissionRun]:
    """Return every mission that the report can need, by name.

    Parameters
    ----------
    duration : float
        Simulated time of a mission [s]; those held for long last five times as long.
    """
    found = {}
    for case in CASES:  # one after the other: two processes would compile their equal equations twice
        for suffix, options in {**FINELY_LOGGED, **OTHERS}.items():
            name, lasts = f"case{case}{suffix}", 5 * duration if suffix == "-long" else duration
            log_step = FINE_LOG_STEP if suffix in FINELY_LOGGED else LOG_STEP
            found[name] = MissionRun(name=name, case=case, duration=lasts, log_step=log_step, **options)
    return found
