"""Where a loop ends, imperfection by imperfection: the source's law, its mode-neutral form, the mean axes.

Each imperfection is alone; all else is exact. The worst value that a loop flies with, and the next at
which it is lost, are found by bisection, with flights of Case 1 on the nonlinear plant.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr
from study_tools.cache import Work, inputs_of

from flight import measures
from flight.draws import parameters_of, tip
from flight.measures import tracking
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.errors import DivergenceError
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.models.hardware.hardware import Hardware
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.reporting import metrics
from trussflow.models.transport.mean_axes_wiring import mean_axes_transport
from trussflow.models.transport.mission import Mission
from trussflow.models.transport.wiring import transport_diagram
from trussflow.models.truss.truss_modes import TrussModes
from trussflow.models.truss.variations import loaded, scaled

DURATION = 80.0
"""The motion takes 60 s [s]."""

POSITION, JOINTS, LATE = 0.05, 0.2, 5e-3
"""Lost is what errs by more, of root [m] or joints [rad], or of the root in the last seconds [m]."""

EARLY = 0.15
"""Share of the flight that is looked at first [-]."""

CLOSE = 1.2
"""Bisection ends when the two values are closer than this factor, or neighbours [-]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Law:
    """A control law, around the plant that suits it.

    Attributes
    ----------
    label : str
        For people.
    plant : callable
        Returns the plant.
    hold, delay : float
        The least that it is flown with: the source's step, or what the mean axes are designed for [s].
    step : float
        Of RK4, and between the times that can be tried [s].
    """

    label: str
    plant: Callable[[], TunableTruss]
    hold: float = 1e-3
    delay: float = 0.0
    step: float = 1e-3

    def diagram(self, truss: TunableTruss, hardware: Hardware) -> Diagram:
        """Return the loop of Case 1 around the plant `truss`, behind `hardware`."""
        mission = Mission.of_case(1)
        if not self.delay:
            return transport_diagram(mission, truss, hardware=hardware)
        design = replace(MeanAxesDesign.shipped(), sample_time=hardware.sample_time)
        return mean_axes_transport(mission, truss, hardware=hardware, design=design)

    def hardware(self, *, hold: float | None = None, more_delay: float = 0.0, **what: float) -> Hardware:
        """Return hardware, exact but for `hold`, `more_delay` [s] and `what` `Hardware.exact` takes besides.

        Computing takes the mean axes another sample time.
        """
        hold = self.hold if hold is None else hold
        return Hardware.exact(hold, more_delay + (hold if self.delay else 0.0), **what)

    def simulator(self, hardware: Hardware, more: tuple[str, ...] = ()) -> tuple[TunableTruss, Simulator]:
        """Return the plant and the loop around it, behind `hardware`; `more` is logged besides the errors."""
        plant = self.plant()
        log = ["truss.task_position", "trajectory.position", *more]
        return plant, Simulator(self.diagram(plant, hardware), step=self.step, log=log, log_step=0.02)


LAWS = {
    "published": Law(label="source's law, published plant", plant=TunableTruss.published),
    "mode-neutral": Law(label="mode-neutral, consistent plant", plant=TunableTruss.consistent),
    "mean axes": Law(
        label="mean axes, accurate plant", plant=TunableTruss.accurate, hold=0.02, delay=0.02, step=2e-3
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Imperfection:
    """One thing that is not as on paper.

    Attributes
    ----------
    label, unit : str
        For people.
    easy, harsh : float
        Where bisection begins [unit].
    hardware : callable
        Takes a law and the value, and returns the hardware.
    truss : callable
        Takes the nominal truss and the value, and returns the truss that flies.
    of_time : bool
        Whether values are whole steps.
    """

    label: str
    unit: str
    easy: float
    harsh: float
    hardware: Callable[[Law, float], Hardware] = lambda law, _: law.hardware()
    truss: Callable[[TrussModes, float], TrussModes] = lambda truss, _: truss
    of_time: bool = False


def _laden(truss: TrussModes, value: float) -> TrussModes:
    damping = truss.damping_ratios[0]
    return loaded(truss.damped(0.0), tip(truss), value).damped(damping)


IMPERFECTIONS = {
    "hold": Imperfection(
        label="commands held for",
        unit="s",
        easy=0.0,
        harsh=0.2,
        hardware=lambda law, value: law.hardware(hold=max(value, law.hold)),
        of_time=True,
    ),
    "delay": Imperfection(
        label="further delay",
        unit="s",
        easy=0.0,
        harsh=0.1,
        hardware=lambda law, value: law.hardware(more_delay=value),
        of_time=True,
    ),
    "noise": Imperfection(
        label="noise of pose, joints, rates",
        unit="m, rad, 1/s",
        easy=1e-7,
        harsh=1e-2,
        hardware=lambda law, value: law.hardware(noise=value),
    ),
    "quantum": Imperfection(
        label="steps of thrust",
        unit="N",
        easy=1e-3,
        harsh=4.0,
        hardware=lambda law, value: law.hardware(quantum=value),
    ),
    "thrust": Imperfection(
        label="limit of thrust",
        unit="N",
        easy=10.0,
        harsh=1.0,
        hardware=lambda law, value: law.hardware(thrust=value),
    ),
    "torque": Imperfection(
        label="limit of all torques",
        unit="N*m",
        easy=10.0,
        harsh=1e-3,
        hardware=lambda law, value: law.hardware(torque=value),
    ),
    "mass": Imperfection(
        label="truss heavier than believed, by",
        unit="%",
        easy=1.0,
        harsh=100.0,
        truss=lambda truss, value: scaled(truss, mass=1.0 + value / 100.0),
    ),
    "payload": Imperfection(label="unknown load at the tip", unit="kg", easy=1.0, harsh=300.0, truss=_laden),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Rung:
    """How much of one imperfection one law flies with.

    Attributes
    ----------
    law, imperfection : str
        Of `LAWS` and `IMPERFECTIONS`.
    duration : float
        Of each flight [s].
    """

    law: str
    imperfection: str
    duration: float = DURATION

    @property
    def name(self) -> str:
        """Its name in the report."""
        return f"{self.imperfection} by {self.law}"

    def work(self, folder: Path) -> Work:
        """Make the rung ready.

        Parameters
        ----------
        folder : pathlib.Path
            Not used: nothing is shared.
        """
        law, what = LAWS[self.law], IMPERFECTIONS[self.imperfection]
        _, simulator = law.simulator(what.hardware(law, what.easy))
        methods = [inspect.getsource(module) for module in (sys.modules[__name__], measures, metrics)]
        return Work((*inputs_of(simulator, self.duration, {}), self.name, *methods), self.compute)

    def compute(self) -> xr.Dataset:
        """Return the worst value flown with and the next, lost at (NaN: none), and all tried."""
        law, what = LAWS[self.law], IMPERFECTIONS[self.imperfection]
        grid = law.step if what.of_time else 0.0
        tried = {value: self.flies(law, what, value) for value in (what.easy, what.harsh)}
        flies = next((v for v in (what.harsh, what.easy) if tried[v]), np.nan)
        lost = next((v for v in (what.easy, what.harsh) if not tried[v]), np.nan)
        while (value := between(flies, lost, grid)) is not None:
            tried[value] = self.flies(law, what, value)
            flies, lost = (value, lost) if tried[value] else (flies, value)
        flown = {"flies": flies, "lost": lost, "flown": ("value", list(tried.values()))}
        return xr.Dataset(flown, {"value": list(tried)})

    def flies(self, law: Law, what: Imperfection, value: float) -> bool:
        """Tell whether the `law` flies with a `value` [any] of the imperfection `what`."""
        plant, simulator = law.simulator(what.hardware(law, value))
        parameters = parameters_of(plant, what.truss(plant.dynamics.modes, value))
        for duration in (EARLY * self.duration, self.duration):  # most of what is lost is lost early
            try:
                run = simulator.run(duration, parameters=parameters, progress=False)
            except DivergenceError:
                return False
            error = tracking(run)
            if error["position"] > POSITION or error["joints"] > JOINTS:
                return False
        return error["late position"] < LATE


def between(flies: float, lost: float, grid: float) -> float | None:
    """Return the value to try next, or None if the two are close, or one is NaN: there is no end.

    Parameters
    ----------
    flies, lost : float
        What flies, at least 0, and what does not, above 0 [any].
    grid : float
        Values are multiples of this one, if it is not 0 [any].
    """
    if np.isnan(flies * lost) or (flies and max(flies / lost, lost / flies) < CLOSE):
        return None
    middle = float(np.sqrt(flies * lost)) if flies else lost / 4.0
    if grid:
        middle = float(np.clip(round(middle / grid), flies // grid + 1, lost // grid - 1) * grid)
    return None if grid and lost - flies < 1.5 * grid else middle


def ladder() -> list[Rung]:
    """Return all rungs."""
    return [Rung(law=law, imperfection=what) for what in IMPERFECTIONS for law in LAWS]
