"""An audit of energy: what was supplied is stored or dissipated, block by block and in the whole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from trussflow.blocks.errors import BlockError, SimulationError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Signals, State
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.energy import EnergyAccount, PowerPair, check_pair
from trussflow.blocks.framework.port import Input, Output, Port
from trussflow.blocks.framework.signal_injection import probed
from trussflow.blocks.framework.system import Driver, System, flatten
from trussflow.blocks.framework.units import mismatch
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.blocks.simulation.solver import SolverSettings, spelled_out
from trussflow.blocks.support.summary import Described, Description
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import by_name, positive, shown

if TYPE_CHECKING:
    import xarray as xr


class EnergyMeter(Block):
    r"""Integrate powers together with the diagram, by its solver.

    .. math:: \dot W = \sum \pm e^T f, \qquad \dot V = \sum D

    Parameters
    ----------
    sizes : sequence of int
        Elements of each pair of ports e and f [-].
    signs : sequence of float
        Sign of each pair [-].
    losses : int
        Elements of the dissipated power D [-].
    """

    supplied = State(unit="J")
    dissipated = State(unit="J")

    def __init__(
        self, sizes: Sequence[int], signs: Sequence[float], losses: int
    ) -> None:
        self.signs = tuple(signs)
        ports: dict[str, Input | Output] = {
            f"{side}{i}": Input(size)
            for i, size in enumerate(sizes)
            for side in ("effort", "flow")
        }
        self.extra_ports = ports | {"loss": Input(losses)}
        super().__init__()

    def derivative(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the powers."""
        powers = [
            sign * (u[f"effort{i}"] @ u[f"flow{i}"])
            for i, sign in enumerate(self.signs)
        ]
        return {"supplied": sum(powers, np.zeros(())), "dissipated": np.sum(u.loss)}


@dataclass(frozen=True, slots=True, repr=False)
class EnergyAudit(Described):
    """Findings of `energy_audit`.

    Attributes
    ----------
    result : xarray.Dataset
        For each time and account ``supplied``, ``stored`` (since the start), ``dissipated``, and what is
        ``missing``: supplied - stored - dissipated [J]. The last account is the whole, named as the diagram.
    drift : dict of str to float
        For each account the largest energy that is missing at any time, relative to the largest that was
        supplied, stored or dissipated [-].
    """

    result: xr.Dataset
    drift: dict[str, float]

    def raise_for_missing(self, tolerance: float) -> None:
        """Raise if more is missing than round-off and the steps of the solver explain, for tests.

        Parameters
        ----------
        tolerance : float
            The largest drift allowed [-].

        Raises
        ------
        SimulationError
            With this audit as its message.
        """
        positive(tolerance=tolerance)
        if not all(drift <= tolerance for drift in self.drift.values()):
            raise SimulationError(
                f"energy is missing, or too much, beyond {tolerance:g}: {self!r}"
            )

    def _described(self) -> Description:
        end = self.result.isel(time=-1)
        lines = {}
        for name, drift in self.drift.items():
            row = end.sel(account=name)
            sums = ", ".join(
                f"{what} {float(row[what]):.6g} J" for what in end.data_vars
            )
            lines[name] = f"{sums}, drift {drift:.1e}"
        return Description(f"energy audit of {float(end['time']):g} s", lines)


@spelled_out(SolverSettings)
def energy_audit(
    diagram: Diagram,
    duration: float,
    *,
    accounts: Mapping[str, EnergyAccount] | None = None,
    supplied: Sequence[PowerPair] | None = None,
    parameters: Mapping[str, Any] | None = None,
    initial: Mapping[str, Any] | None = None,
    log_step: float | None = None,
    **settings: Unpack[SolverSettings],
) -> EnergyAudit:
    r"""Run a diagram and compare the energy supplied with what is stored and dissipated.

    .. math:: W_{supplied} = \Delta E_{stored} + W_{dissipated} + W_{missing}

    Blocks that declare an `EnergyAccount` as their ``energy_account`` are audited, and those in `accounts`.
    Powers are integrated along with the states, so what is missing is wrong, or the solver's error.

    Parameters
    ----------
    diagram : Diagram
        Diagram to simulate; it does not change.
    duration : float
        Time to simulate [s].
    accounts : mapping, optional
        More accounts by name, with ports of the diagram; one named as a block replaces the block's own.
    supplied : sequence of pairs of ports, optional
        Through which pairs power comes into the whole. If all blocks balance and the whole does not, then
        a wire between them has a wrong sign or factor. By default the whole is the sum of its blocks.
    parameters, initial
        As for `Simulator.run` [as declared].
    log_step : float, optional
        As for `Simulator` [s].
    step, solver, backend, rtol, atol
        Of the `Solver` [s, -, -, -, unit of the state].

    Returns
    -------
    EnergyAudit
        Energies over time; it prints as a table.

    Raises
    ------
    BlockError
        If a pair of ports is no power, or what is stored or dissipated is no energy.
    SimulationError
        If there is no account.

    Notes
    -----
    A state that jumps at an event may take energy away at once. A block that counts such losses, by a mode,
    gives them as `dissipated` in J.

    Examples
    --------
    >>> from trussflow.blocks import Block, EnergyAccount, Output, Parameter, State
    >>> class Ball(Block):
    ...     height, speed, energy = Output(unit="m"), Output(unit="m/s"), Output(unit="J")
    ...     z, v = State(initial=1.0), State()
    ...     energy_account = EnergyAccount(stored="energy")
    ...
    ...     def output(self, t, x, u, p):
    ...         return {"height": x.z, "speed": x.v, "energy": 9.81 * x.z + x.v**2 / 2}
    ...
    ...     def derivative(self, t, x, u, p):
    ...         return {"z": x.v, "v": -9.81}
    >>> diagram = Diagram("fall")
    >>> ball = diagram.add(ball=Ball())
    >>> energy_audit(diagram, 0.4, step=0.1).raise_for_missing(1e-12)
    """
    system = flatten(diagram)
    own = {
        path: block.energy_account.of(block)
        for path, block in system.blocks.items()
        if block.energy_account
    }
    found = {**own, **by_name("accounts", accounts)}
    if not found:
        raise SimulationError(
            f"cannot audit '{diagram.name}': no block in it has an energy_account; declare one, "
            "or give accounts="
        )
    whole = diagram.name
    log = dict[str, Port | str]()
    for name, account in found.items():
        if not isinstance(account, EnergyAccount) or name == whole:
            raise SimulationError(
                f"cannot audit {shown(name)} by {shown(account)}: give EnergyAccounts by name"
            )
        system = _metered(system, name, account, log)
    if supplied is not None:
        system = _metered(system, whole, EnergyAccount(supplied=supplied), log)
    result = Simulator(system, log=log, log_step=log_step, **settings).run(
        duration, parameters=parameters, initial=initial
    )
    return _audit(result, [*found], whole, supplied is not None)


def _metered(
    system: System, name: str, account: EnergyAccount, log: dict[str, Port | str]
) -> System:
    """Return a `system` with a meter for an `account`, and put into `log` what tells its energies."""
    ports: dict[str, Port] = {}
    for i, pair in enumerate((*account.supplied, *account.delivered)):
        effort, flow = (system.port(port) for port in pair)
        check_pair(effort, flow)
        ports |= {f"effort{i}": effort, f"flow{i}": flow}
    energies = {
        what: system.port(port)
        for what, port in (("stored", account.stored), ("lost", account.dissipated))
        if port is not None
    }
    for what, port in energies.items():
        faults = {mismatch(unit, "J") for unit in port.element_units() if unit}
        if what == "lost" and faults != {""}:
            faults = {mismatch(unit, "W") for unit in port.element_units() if unit}
            ports["loss"] = port
        else:
            log[f"{name} {what}"] = port
        if faults - {""}:
            raise BlockError(
                f"cannot take {port.describe()} for what is {what} in '{name}': {max(faults)}"
            )
    signs = [1.0] * len(account.supplied) + [-1.0] * len(account.delivered)
    sizes = [len(ports[f"effort{i}"].element_units()) for i in range(len(signs))]
    meter = EnergyMeter(
        sizes, signs, ports["loss"].elements().size if "loss" in ports else 0
    )
    meter.named(f"(energy of {name})")
    log |= {f"{name} {state}": f"{meter.path}.{state}" for state in meter.states()}
    drivers: dict[tuple[str, str], list[Driver]] = {}
    for own, port in ports.items():
        system, source = probed(system, port)
        taken = source.elements().ravel()
        whole = replace(source, index=None)
        drivers[meter.path, own] = [
            Driver(whole, taken, np.arange(taken.size), "energy audit")
        ]
    drivers.setdefault((meter.path, "loss"), [])
    return replace(
        system,
        blocks=system.blocks | {meter.path: meter},
        drivers=system.drivers | drivers,
    )


def _audit(
    result: xr.Dataset, names: Sequence[str], whole: str, told: bool
) -> EnergyAudit:
    """Return the energies that a run logged for the accounts of those `names`, and for the `whole`."""
    import xarray as xr

    def energy(name: str, what: str) -> Vector:
        signal = result.get(f"{name} {what}")
        return (
            np.zeros(result.sizes["time"])
            if signal is None
            else signal.values.reshape(len(signal), -1).sum(1)
        )

    columns: dict[str, list[Vector]] = {
        "supplied": [energy(name, "supplied") for name in names],
        "stored": [energy(name, "stored") for name in names],
        "dissipated": [
            energy(name, "dissipated") + energy(name, "lost") - energy(name, "lost")[0]
            for name in names
        ],
    }
    for what, found in columns.items():
        found.append(
            energy(whole, what)
            if told and what == "supplied"
            else np.sum(found, axis=0)
        )
    tables = {what: np.stack(found, axis=1) for what, found in columns.items()}
    largest = np.max([np.abs(table).max(axis=0) for table in tables.values()], axis=0)
    tables["stored"] = tables["stored"] - tables["stored"][0]
    tables["missing"] = tables["supplied"] - tables["stored"] - tables["dissipated"]
    missing = np.abs(tables["missing"]).max(axis=0)
    drift = np.divide(missing, largest, out=np.zeros_like(missing), where=missing > 0)
    labels = [*names, whole]
    variables = {
        what: (("time", "account"), table, {"units": "J"})
        for what, table in tables.items()
    }
    audited = xr.Dataset(
        variables, {"time": result["time"], "account": labels}, result.attrs
    )
    return EnergyAudit(audited, dict(zip(labels, drift.tolist(), strict=True)))
