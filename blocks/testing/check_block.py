"""Check of a block by itself: its declarations, and its equations at random points."""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise, product
from traceback import walk_tb

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import (
    BlockError,
    NameLookupError,
    TracingError,
    TrussflowError,
)
from trussflow.blocks.framework.block import Block, check_kind
from trussflow.blocks.framework.declarations import (
    Event,
    Mode,
    Parameter,
    Signals,
    State,
)
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.equations import Equations
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.run_state import Running
from trussflow.blocks.framework.system import flatten
from trussflow.blocks.linear_analysis.python_derivatives import offered
from trussflow.blocks.simulation.block_instances import open_block
from trussflow.blocks.support.summary import Described, Description
from trussflow.blocks.support.types import Array
from trussflow.blocks.support.validation import by_name, finite_array, shown
from trussflow.blocks.tracing import block_check
from trussflow.blocks.tracing.call_checks import checked, equation, running_errors

DIFFERENCE_STEP = 1e-6
"""Step of differences of numbers of the order of one [-]."""

DERIVATIVE_TOLERANCE = 1e-4
"""Tolerance of derivatives, relative to the largest one of the same signal, or to one [-]."""

RANDOM_POINTS = 12
"""Number of random points at which a block is checked [-]."""

CHECKS = (
    "declarations",
    "numbers",
    "purity",
    "tracing",
    "feedthrough",
    "derivatives",
    "units",
)
"""Checks in their order; each is a method of `Bench`."""

Values = dict[tuple[str, str], Array]
"""Values of the equations, keyed by kind and name of a port or state."""


class FaultError(Exception):
    """A check failed; the message has the fault, its place and the remedy."""


class NotApplicableError(Exception):
    """A check does not apply to this block; the message has the reason."""


class Bench:
    """Base of the checks; each check returns a remark or raises an error.

    Parameters
    ----------
    block : Block
        The block.
    around : mapping
        As for `check_block`.
    """

    def __init__(self, block: Block, around: Mapping[str, npt.ArrayLike]) -> None:
        self.block = block
        self.around = around
        self.p = Signals(f"block '{block.path}'", block.parameters)
        for value in self.p.values():
            # Equations must not write into parameters. A deep copy of a read-only array
            # is writable.
            value.setflags(write=False)
        self.closing = contextlib.ExitStack()  # closes what a check has opened
        self.kinds: list[str] = []
        self.points: list[list[Array]] = []

    def declarations(self) -> str:
        """Check that the block can be flattened, and that its initial states are finite."""
        block = self.block
        check_kind(block)
        flatten(block, external=True)
        self.kinds = block_check.kinds(block)
        self.shapes = block_check.argument_shapes(block)
        sizes = {"": ()} | self.shapes[0] | self.shapes[1] | self.shapes[2]
        for name in self.around:
            if name not in sizes:
                there = ", ".join(name for name in sizes if name)
                raise NameLookupError(
                    f"{self.p.owner} has no state or input '{name}'; there are: {there}"
                )
        about = {
            name: finite_array(f"'{name}'", value, sizes[name])
            for name, value in self.around.items()
        }
        # Only random points: special values, such as 1e300, are for the comparison of
        # compiled code.
        for point in block_check.points(tuple(sizes.values()), RANDOM_POINTS)[
            :RANDOM_POINTS
        ]:
            pairs = zip(sizes, point, strict=True)
            arrays = [about[n] + 0.1 * v if n in about else v for n, v in pairs]
            for array in arrays:
                array.setflags(write=False)
            self.points.append(arrays)
        modes = block.declared(Mode)
        for name in self.shapes[0]:
            first = block.initial(name, self.p)
            if not (np.isfinite(first) | (np.isinf(first) & (name in modes))).all():
                raise FaultError(
                    f"state '{name}' does not begin with a finite number; see initial= of it"
                )
        handled = [e for e in block.declared(Event).values() if e.kind != "terminal"]
        if handled and not (block.hides or block.states_own("on_event")):
            return (
                "no on_event(): the solver stops at the events, but they change nothing"
            )
        return ""

    def opened(self) -> Equations:
        """Return the equation object, as at the beginning of a run."""
        if self.block.steps_itself:
            raise NotApplicableError(
                "the block steps itself, so its equations cannot be called at any point"
            )
        # A block with hidden states gets new equations for each call, so that calls do
        # not depend on each other.
        if not self.block.hides:
            return self.block
        own = open_block(self.block, self.p)
        if isinstance(own, Running):
            self.closing.callback(own.close)
        return own

    def arguments(
        self, point: list[Array]
    ) -> tuple[Array, Signals, Signals, Signals, Signals]:
        """Return read-only values at a point: time, states, inputs, parameters, events that happen."""
        numbers = iter(point)
        # Runs begin at time 0 by default: equations may assume t >= 0.
        t = np.abs(next(numbers))
        x, u, fired = (
            Signals(self.p.owner, {name: next(numbers) for name in shapes})
            for shapes in self.shapes
        )
        happens = {name: value > 0 for name, value in fired.items()}
        return np.asarray(t), x, u, self.p, Signals(self.p.owner, happens)

    def values(self, own: Equations, kinds: list[str], point: list[Array]) -> Values:
        """Return the values of equations of those `kinds` of the object `own` at a `point`."""
        found: Values = {}
        given = self.arguments(point)
        for kind in kinds:
            with (
                np.errstate(all="ignore"),
                running_errors(self.block, kind, float(given[0])),
            ):
                returned = equation(own, kind, given[-1])(*given[:-1])
                for name, value in checked(self.block, kind, returned).items():
                    found[kind, name] = np.array(value, dtype=float)
        return found

    def numbers(self) -> str:
        """Check that equations return what is declared, and finite numbers somewhere."""
        good = list[tuple[list[Array], Values]]()
        refused = list[TrussflowError]()
        self.points, points = [], self.points
        for point in points:
            happens = any(v.any() for v in self.arguments(point)[-1].values())
            # A run calls `on_event` only after an event, so that it may rely on one.
            kinds = [kind for kind in self.kinds if kind != "on_event" or happens]
            try:
                good.append((point, self.values(self.opened(), kinds, point)))
            # A wrong shape or name is a fault of the block at all points, while other
            # errors may come from values outside of its domain.
            except BlockError:
                raise
            except TrussflowError as error:
                refused.append(error)
        if not good and "read-only" in str(refused[0]):
            raise FaultError(
                f"{refused[0]}: an equation writes into an argument, which others read, too; return a new "
                "array: np.where, np.concatenate, or a copy"
            )
        if not good:
            raise refused[0]
        self.points = [point for point, _ in good]
        remarks = []
        if refused:
            remarks.append(
                f"{len(refused)} of {RANDOM_POINTS} random points are refused: {refused[0]}"
            )
        for kind, name in dict.fromkeys(key for _, each in good for key in each):
            values = [each[kind, name] for _, each in good if (kind, name) in each]
            # A time event at infinity never happens, and a mode may store such a time.
            may_be_infinite = kind == "indicators" or name in self.block.declared(Mode)
            bad = sum(
                not (np.isfinite(v) | (np.isinf(v) & may_be_infinite)).all()
                for v in values
            )
            where = f"{kind}(): '{name}' is not finite at"
            if bad == len(values):
                raise FaultError(
                    f"{where} any random point, such as {_listed(values[0])}; look for a division by zero, "
                    "the root or logarithm of a negative number, or give valid values by around="
                )
            if bad:
                remarks.append(
                    f"{where} {bad} of {len(values)} random points: is that outside its domain?"
                )
        return "; ".join(remarks)

    def purity(self) -> str:
        """Check that equal arguments give equal numbers, regardless of calls in between."""
        # With hidden states, only the output is a function of its arguments.
        kinds = ["output"] if self.block.hides else self.kinds[:2]
        # The order a, b, a reveals memory, new equations a random start.
        for first, second in pairwise([*self.points, self.points[0]]):
            own = self.opened()
            fresh = self.opened()
            calls = (own, first), (own, second), (own, first), (fresh, first)
            once, _, *others = (
                self.values(each, kinds, point) for each, point in calls
            )
            for again in others:
                for kind, name in (
                    key for key in once if not _same(once[key], again[key])
                ):
                    raise FaultError(
                        f"{kind}(): '{name}' is {_listed(once[kind, name])}, then "
                        f"{_listed(again[kind, name])} for the same arguments: it uses random numbers, reads "
                        "a clock, or keeps something between calls. Declare kept values as a State, use "
                        "Noise for random numbers; a Python block may return a Running from open()"
                    )
        return ""

    def tracing(self) -> str:
        """Check that the block traces, and that the traced equations give the numbers of NumPy."""
        if not self.block.traced:
            raise NotApplicableError(
                "the block declares traced = False, and runs in Python"
            )
        block_check.isolate(self.block)
        return ""

    def feedthrough(self) -> str:
        """Check that the direct feedthrough of the outputs is the declared one."""
        declared = block_check.isolate(self.block).feedthrough
        depends = "; ".join(
            f"{y} depends on {', '.join(sorted(u)) or 'no input'}"
            for y, u in declared.items()
        )
        if self.block.traced:
            return f"direct feedthrough: {depends}" if depends else ""
        real = {output: set[str]() for output in declared}
        for point, other in pairwise([*self.points, self.points[0]]):
            before = self.values(self.opened(), ["output"], point)
            # Points are in the order time, states, inputs, events.
            for i, name in enumerate(self.shapes[1], 1 + len(self.shapes[0])):
                after = self.values(
                    self.opened(), ["output"], [*point[:i], other[i], *point[i + 1 :]]
                )
                for (_, output), value in before.items():
                    if not _same(value, after["output", output]):
                        real[output].add(name)
        seen_inputs = {output: tuple(sorted(seen)) for output, seen in real.items()}
        advice = f"Let feedthrough() return {seen_inputs}"
        for output, seen in real.items():
            if missing := sorted(seen - declared[output]):
                raise FaultError(
                    f"output '{output}' depends on {', '.join(missing)}, which feedthrough() does "
                    f"not declare: in a run these inputs would be NaN. {advice}"
                )
        if all(declared[output] == seen for output, seen in real.items()):
            return ""
        remark = f"declared feedthrough: {depends}; the values show less. {advice}"
        if type(self.block).feedthrough is Block.feedthrough:
            return f"{remark} to close a loop around the block"
        raise FaultError(f"{remark}: unnecessary feedthrough makes algebraic loops")

    def derivatives(self) -> str:
        """Compare the derivatives that a Python block offers with differences of its values."""
        if self.block.traced or offered(self.block, self.opened()) is None:
            raise NotApplicableError(
                "tracing gives exact derivatives; a Python block may offer directional_derivative()"
            )
        modes = self.block.declared(Mode)
        states, inputs, _ = self.shapes
        names = [f"x.{n}" for n in states] + [f"u.{n}" for n in inputs]
        kinds = [k for k in self.kinds if k in ("output", "update", "derivative")]
        for point, kind in product(self.points, kinds):
            for i, name in enumerate(names, 1):
                # Modes are piecewise constant and have no derivatives.
                if name.removeprefix("x.") not in modes:
                    self._check_derivative(point, kind, i, name)
        return ""

    def _check_derivative(
        self, point: list[Array], kind: str, number: int, name: str
    ) -> None:
        """Compare the derivative of an equation along an array of a point with a difference."""
        along = [np.zeros_like(value) for value in point]
        # One direction changes all elements: one difference for each array.
        along[number] = np.ones_like(point[number])
        before, after = (
            self.values(
                self.opened(),
                [kind],
                [v + h * d for v, d in zip(point, along, strict=True)],
            )
            for h in (-DIFFERENCE_STEP, DIFFERENCE_STEP)
        )
        own = offered(self.block, self.opened())
        assert own is not None
        given, (_, dx, du, _, _) = self.arguments(point)[:4], self.arguments(along)
        for key, value in after.items():
            with running_errors(self.block, "directional_derivative", float(given[0])):
                found = np.asarray(own(kind, *given, dx, du)[key[1]], dtype=float)
            expected = (value - before[key]) / (2.0 * DIFFERENCE_STEP)
            allowed = DERIVATIVE_TOLERANCE * np.abs(expected).max(initial=1.0)
            # Negated, so that a derivative of NaN is wrong. Differences that are not
            # finite are outside of the domain.
            wrong = ~(np.abs(found - expected) <= allowed) & np.isfinite(expected)
            if wrong.any():
                raise FaultError(
                    f"{kind}(): the derivative of '{key[1]}' by {name} is {_listed(found)}, by differences "
                    f"{_listed(expected)}; look at directional_derivative()"
                )

    def units(self) -> str:
        """Return a remark on declarations without a unit."""
        declared = {**self.block._declared, **self.block.extra_ports}
        without = [
            name
            for name, declaration in declared.items()
            if isinstance(declaration, Input | Output | State | Parameter)
            and not isinstance(declaration, Mode)
            and declaration.unit is None
        ]
        return (
            f"no unit is declared for {', '.join(without)}: wires there are not checked"
            if without
            else ""
        )


def _same(one: Array, other: Array) -> bool:
    """Return whether numbers are exactly equal; NaN equals NaN."""
    return np.array_equal(one, other, equal_nan=True)


def _listed(value: Array) -> str:
    """Return numbers for a message."""
    return shown(np.round(value, 6).tolist())


@dataclass(frozen=True, slots=True, repr=False)
class BlockReport(Described):
    """Findings of `check_block`.

    Attributes
    ----------
    block : str
        Path and class of the block.
    findings : dict of str to str
        Finding of each check: ``"passed"``, ``"FAILED: ..."`` or ``"not applicable: ..."``, with the fault,
        its place and the remedy.
    """

    block: str
    findings: dict[str, str]

    @property
    def failures(self) -> dict[str, str]:
        """The findings of the checks that failed."""
        return {
            name: text
            for name, text in self.findings.items()
            if text.startswith("FAILED")
        }

    def raise_for_failures(self) -> None:
        """Raise if a check failed, for tests.

        Raises
        ------
        BlockError
            With this report as its message.
        """
        if self.failures:
            raise BlockError(repr(self))

    def _described(self) -> Description:
        failed = f"{len(self.failures)} of {len(self.findings)} checks failed"
        return Description(
            f"{self.block}: {failed if self.failures else 'all is well'}", self.findings
        )


def check_block(
    block: Block, *, around: Mapping[str, npt.ArrayLike] | None = None
) -> BlockReport:
    """Check the declarations of a single block, and its equations at random points.

    Parameters
    ----------
    block : Block
        The block. Shapes that follow from wires are those of the connected diagram, or else scalar.
    around : mapping, optional
        Values of states and inputs, by name, for a block with a limited domain: points differ from them by
        at most 0.1. All other values are between -1 and 1 [units as declared].

    Returns
    -------
    BlockReport
        A finding for each check; its text says what to do.

    Raises
    ------
    BlockError
        If it is not a block, or is a diagram; check the blocks of a diagram one by one.

    Examples
    --------
    >>> from trussflow.blocks import TransferFunction
    >>> from trussflow.blocks.testing import check_block
    >>> report = check_block(TransferFunction([1.0], [0.5, 1.0]))
    >>> report.raise_for_failures()
    >>> report.findings["feedthrough"]
    'passed: direct feedthrough: y depends on no input'
    """
    given: object = block
    if not isinstance(given, Block) or isinstance(given, Diagram):
        raise BlockError(
            f"cannot check {shown(block)}: give one block, such as MyBlock()"
        )
    # Checks must not change the user's block. A block in a diagram has its shapes from
    # the wires there and cannot be copied alone.
    item = copy.deepcopy(block) if block.parent is None else block
    findings = dict[str, str]()
    bench = Bench(item, by_name("values around which to check", around))
    for name in CHECKS:
        try:
            with bench.closing:
                told = getattr(bench, name)()
            findings[name] = f"passed: {told}" if told else "passed"
        except NotApplicableError as reason:
            findings[name] = f"not applicable: {reason}"
        except TracingError as error:
            findings[name] = (
                f"FAILED: {error}"
                if name == "tracing"
                else "not applicable: it does not trace"
            )
        except (FaultError, TrussflowError) as fault:
            findings[name] = f"FAILED: {fault}"
        except Exception as error:  # noqa: BLE001 - the block is the user's
            findings[name] = f"FAILED: {_raised(item, error)}"
        # Later checks need points at which the equations can be computed.
        if not bench.points:
            break
    return BlockReport(f"{item.path} ({type(item).__name__})", findings)


def _raised(block: Block, error: Exception) -> str:
    """Return a text with the method of the user's `block` that raised an unexpected `error`."""
    frames = [frame for frame, _ in walk_tb(error.__traceback__)]
    users = [
        f
        for f in frames
        if not str(f.f_globals.get("__name__")).startswith("trussflow.blocks.")
    ]
    method = (users or frames[-1:])[0].f_code.co_name
    return f"{method}() of block '{block.path}' raised {type(error).__name__}: {error}"
