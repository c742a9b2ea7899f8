"""Audit of energy: supplied energy is stored or dissipated, in each block and in the whole diagram."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from trussflow.blocks.errors import BlockError, SimulationError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Signals, State
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.energy import EnergyAccount, PowerPair
from trussflow.blocks.framework.port import Input, Port
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
    ports : mapping of str to Port
        Ports e and f of each pair, as ``effort0``, ``flow0`` and so on, and ``loss``, the port of D.
    signs : sequence of float
        Sign of each pair [-].
    """

    supplied = State(unit="J")
    dissipated = State(unit="J")

    def __init__(self, ports: Mapping[str, Port], signs: Sequence[float]) -> None:
        self.signs = tuple(signs)
        self.elements = {name: port.elements().ravel() for name, port in ports.items()}
        self.extra_ports = {
            name: Input(port.whole_shape or (), default=port.declaration.default)
            for name, port in ports.items()
        }
        super().__init__()

    def derivative(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the powers."""
        # Meters read whole ports, of which a pair may use a slice only.
        chosen = {name: np.ravel(u[name])[i] for name, i in self.elements.items()}
        powers = [
            sign * (chosen[f"effort{i}"] @ chosen[f"flow{i}"])
            for i, sign in enumerate(self.signs)
        ]
        lost = np.sum(chosen["loss"]) if "loss" in chosen else np.zeros(())
        return {"supplied": sum(powers, np.zeros(())), "dissipated": lost}


@dataclass(frozen=True, slots=True, repr=False)
class EnergyAudit(Described):
    """Findings of `energy_audit`.

    Attributes
    ----------
    result : xarray.Dataset
        Energies ``supplied``, ``stored`` (since the start), ``dissipated`` and ``missing`` = supplied - stored -
        dissipated, over time and account [J]. The last account is the whole, with the name of the diagram.
    drift : dict of str to float
        Largest missing energy of each account, relative to its largest supplied, stored or dissipated energy
        [-].
    """

    result: xr.Dataset
    drift: dict[str, float]

    def raise_for_missing(self, tolerance: float) -> None:
        """Raise an error if the missing energy exceeds a tolerance, for tests.

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
                f"missing or surplus energy exceeds {tolerance:g}: {self!r}"
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
    r"""Simulate a diagram and compare supplied energy with stored and dissipated energy.

    .. math:: W_{supplied} = \Delta E_{stored} + W_{dissipated} + W_{missing}

    Blocks that declare an `EnergyAccount` as their ``energy_account`` are audited, and those in `accounts`.
    Powers are integrated with the states, so that missing energy is an error of the model or of the solver.

    Parameters
    ----------
    diagram : Diagram
        Diagram to simulate; it does not change.
    duration : float
        Time to simulate [s].
    accounts : mapping, optional
        More accounts by name, with ports of the diagram; an account with the path of a block replaces that of the block.
    supplied : sequence of pairs of ports, optional
        Pairs of ports that supply power to the whole. If all blocks balance and the whole does not, a wire
        between them has a wrong sign or factor. By default the whole is the sum of its blocks.
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
        If the product of a pair of ports is not a power, or a stored or dissipated signal is not an energy.
    SimulationError
        If there is no account.

    Notes
    -----
    A jump of a state at an event may remove energy. A block can sum such losses in a mode and declare it as
    `dissipated` in J.

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
    found: dict[str, object] = {
        path: block.energy_account
        for path, block in system.blocks.items()
        if block.energy_account
    }
    given = by_name("accounts", accounts)
    found |= given
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
        prefix = "" if name in given else f"{name}."
        system = _metered(system, name, account, prefix, log)
    if supplied is not None:
        account = EnergyAccount(supplied=supplied)
        system = _metered(system, whole, account, "", log)
    result = Simulator(system, log=log, log_step=log_step, **settings).run(
        duration, parameters=parameters, initial=initial
    )
    return _audit(result, [*found], whole, supplied is not None)


def _metered(
    system: System,
    name: str,
    account: EnergyAccount,
    prefix: str,
    log: dict[str, Port | str],
) -> System:
    """Return a `system` with a meter for an `account`, and put the signals of its energies into `log`.

    Names of ports follow the `prefix`.
    """

    def port(reference: Port | str) -> Port:
        text = isinstance(reference, str)
        return system.port(f"{prefix}{reference}" if text else reference)

    ports: dict[str, Port] = {}
    for i, pair in enumerate((*account.supplied, *account.delivered)):
        effort, flow = map(port, pair)
        _check_pair(effort, flow)
        ports |= {f"effort{i}": effort, f"flow{i}": flow}
    for kind in ("stored", "dissipated"):
        reference = getattr(account, kind)
        if reference is None:
            continue
        energy = port(reference)
        units = {*filter(None, energy.element_units())}
        faults = {mismatch(unit, "J") for unit in units}
        # Energy in J is logged as it is; the meter integrates a power in W.
        if kind == "dissipated" and faults != {""}:
            faults = {mismatch(unit, "W") for unit in units}
            ports["loss"] = energy
        else:
            log[f"{name} {kind} energy"] = energy
        if faults - {""}:
            raise BlockError(
                f"cannot use {energy.describe()} as {kind} energy of '{name}': {max(faults)}"
            )
    signs = [1.0] * len(account.supplied) + [-1.0] * len(account.delivered)
    meter = EnergyMeter(ports, signs).named(f"(energy of {name})")
    log |= {f"{name} {state}": f"{meter.path}.{state}" for state in meter.states()}
    drivers = dict(system.drivers)
    for own, source in ports.items():
        whole = replace(source, index=None)
        everything = np.arange(source.size)
        drivers[meter.path, own] = (
            # An input has no value of its own: the meter reads what drives it.
            system.drivers[source.block.path, source.name]
            if source.is_input
            else [Driver(whole, everything, everything, "energy audit")]
        )
    blocks = system.blocks | {meter.path: meter}
    return replace(system, blocks=blocks, drivers=drivers)


def _check_pair(effort: Port, flow: Port) -> None:
    """Check that the product of two ports is a power in W, if their units are known.

    Raises
    ------
    BlockError
        If the sizes differ, or the product has another unit.
    """
    cannot = f"{effort.describe()} and {flow.describe()} are no power pair:"
    units = effort.element_units(), flow.element_units()
    if len(units[0]) != len(units[1]):
        raise BlockError(
            f"{cannot} they have {len(units[0])} and {len(units[1])} elements"
        )
    for first, second in zip(*units, strict=True):
        product = f"({first or 1})*({second or 1})"
        known = first is not None and second is not None
        if known and (fault := mismatch(product, "W")):
            raise BlockError(f"{cannot} of their product, {fault}")


def _audit(
    result: xr.Dataset, names: Sequence[str], whole: str, supplied: bool
) -> EnergyAudit:
    """Return the energies that a run logged for the accounts of those `names`, and for the `whole`.

    The whole has its own supplied energy if `supplied` is true.
    """
    import xarray as xr

    def energy(name: str, kind: str) -> Vector:
        """Return the sum of the integral and the signal of an energy."""
        total = np.zeros(result.sizes["time"])
        for key in (f"{name} {kind}", f"{name} {kind} energy"):
            if key in result:
                total += result[key].values.reshape(total.size, -1).sum(1)
        return total

    tables = {}
    for kind in ("supplied", "stored", "dissipated"):
        columns = [energy(name, kind) for name in names]
        own = supplied and kind == "supplied"
        columns.append(energy(whole, kind) if own else np.sum(columns, axis=0))
        tables[kind] = np.stack(columns, axis=1)
    # Before the initial energy is subtracted: a large energy that changes little would
    # otherwise show its round-off as drift.
    largest = np.max([np.abs(table).max(axis=0) for table in tables.values()], axis=0)
    tables = {kind: table - table[0] for kind, table in tables.items()}
    tables["missing"] = tables["supplied"] - tables["stored"] - tables["dissipated"]
    missing = np.abs(tables["missing"]).max(axis=0)
    # Without any energy, nothing is missing: 0, not 0 / 0.
    drift = np.divide(missing, largest, out=np.zeros_like(missing), where=missing > 0)
    labels = [*names, whole]
    variables = {
        kind: (("time", "account"), table, {"units": "J"})
        for kind, table in tables.items()
    }
    audited = xr.Dataset(
        variables, {"time": result["time"], "account": labels}, result.attrs
    )
    return EnergyAudit(audited, dict(zip(labels, drift.tolist(), strict=True)))
