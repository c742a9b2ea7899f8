"""What it brings to spare propellant and wheels: flights with and without `ActuatorEconomy`."""

from __future__ import annotations

import inspect
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr
from study_tools.cache import Work, inputs_of

from flight import flights, measures
from flight.draws import NOMINAL
from flight.flights import DURATION, Flights
from flight.measures import measured
from trussflow.models.reporting import metrics

HELD = (3.0, 2.0, 1.0)
"""Momentum of the wheels of each base at the start, by axis [N·m·s]."""

SPENT = 0.3
"""What base 1 has used before, and the others have not [kg]."""

NEVER = 1e9
"""In place of a spread [kg] or time [s]: nothing is spared."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sparing:
    """A case on the nominal truss, begun with wheels that turn and tanks that are not alike.

    Attributes
    ----------
    case : int
        1 or 2.
    spared : bool
        Whether propellant and wheels are spared.
    duration : float
        Of the flight [s].
    """

    case: int
    spared: bool
    duration: float = DURATION

    @property
    def name(self) -> str:
        """Its name in the report."""
        return f"case {self.case}, {'sparing' if self.spared else 'not sparing'}"

    def work(self, folder: Path) -> Work:
        """Make the flight ready.

        Parameters
        ----------
        folder : pathlib.Path
            Not used: nothing is shared.
        """
        flying = Flights(self.case, more=["actuators.stored.y"])
        parameters = flying.parameters(NOMINAL)
        if not self.spared:
            names = ("propellant_spread", "unloading_time")
            parameters |= {f"controller.economy.{name}": NEVER for name in names}
        start: dict[str, Any] = {f"actuators.wheels_{i + 1}.h": HELD for i in range(flying.plant.robots)}
        start["actuators.thrusters_1.tank.integral"] = SPENT

        def compute() -> xr.Dataset:
            run = flying.simulator.run(self.duration, parameters=parameters, initial=start, progress=False)
            told = measured(run)
            used = run["actuators.used.y"].values[-1].copy()
            used[0] -= SPENT
            held = abs(run["actuators.stored.y"].values[-1]).reshape(-1, len(HELD))
            return xr.Dataset(
                {
                    **{name: told[name] for name in ("position", "attitude", "late position")},
                    "used": ("base", used),
                    "held": ("axis", held.max(axis=0)),
                }
            )

        modules = (sys.modules[__name__], flights, measures, metrics)
        methods = [inspect.getsource(module) for module in modules]
        return Work((*inputs_of(flying.simulator, self.duration, {}), repr((self, start)), *methods), compute)
