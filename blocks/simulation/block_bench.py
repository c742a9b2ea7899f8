"""A block by itself on a bench: its equations are called at random points, and what they do is looked at."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Mode, Parameter, Signals, State
from trussflow.blocks.framework.equations import Equations
from trussflow.blocks.framework.errors import BlockError, NameLookupError, TrussflowError
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.system import flatten
from trussflow.blocks.framework.types import Array, Vector
from trussflow.blocks.framework.validation import finite_array, shown
from trussflow.blocks.simulation.block_instances import open_block
from trussflow.blocks.simulation.executor import NumPyExecutor
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.simulation.solver import Solver
from trussflow.blocks.tracing import block_check
from trussflow.blocks.tracing.calling import checked, running_errors
from trussflow.blocks.tracing.compile_cache import CompilationError

RANDOM_POINTS = 12
"""Number of random points at which a block is checked [-]."""

ROUND_OFF = 1e-9
"""Between two orders of the same operations."""

Values = dict[tuple[str, str], Array]
"""Values of the equations, keyed by kind and name of a port or state."""


class FaultError(Exception):
    """A check failed; the message says what, where, and what to do."""


class NotApplicableError(Exception):
    """A check says nothing about this block; the message says why."""


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
        self.block, self.around, self.writes = block, around, ""
        self.p = Signals(f"block '{block.path}'", block.parameters)
        self.kinds: list[str] = []
        self.points: list[list[Array]] = []

    def declarations(self) -> str:
        """See whether it can be built, and its states begin with numbers."""
        block = self.block
        block_check.check_kind(block)
        flatten(block, external=True)
        self.kinds, self.shapes = block_check.kinds(block), block_check.shapes_of(block)
        sizes = {"": ()} | self.shapes[0] | self.shapes[1] | self.shapes[2]
        for name in self.around:
            if name not in sizes:
                there = ", ".join(name for name in sizes if name)
                raise NameLookupError(f"{self.p.owner} has no state or input '{name}'; there are: {there}")
        about = {name: finite_array(f"'{name}'", value, sizes[name]) for name, value in self.around.items()}
        for point in block_check.points(tuple(sizes.values()), RANDOM_POINTS)[:RANDOM_POINTS]:
            pairs = zip(sizes, point, strict=True)
            self.points.append([about[n] + 0.1 * v if n in about else v for n, v in pairs])
        modes = block.declared(Mode)
        for name in self.shapes[0]:
            first = block.initial(name, self.p)
            if not (np.isfinite(first) | (np.isinf(first) & (name in modes))).all():
                raise FaultError(f"state '{name}' does not begin with a finite number; see initial= of it")
        return ""

    def opened(self) -> Equations:
        """Return what states the equations, as in a run that begins."""
        if self.block.steps_itself:
            raise NotApplicableError("the block steps itself, so its equations cannot be called at any point")
        return open_block(self.block, self.p) if self.block.hides else self.block

    def arguments(self, point: list[Array]) -> tuple[Array, Signals, Signals, Signals, Signals]:
        """Return copies of what is at a point: time, states, inputs, parameters, events that happen."""
        numbers, owner = iter(point), self.p.owner
        t = np.array(np.abs(next(numbers)))
        x, u, fired = (Signals(owner, {n: next(numbers).copy() for n in shapes}) for shapes in self.shapes)
        happens = {n: value > 0 for n, value in fired.items()}
        return t, x, u, Signals(owner, {n: v.copy() for n, v in self.p.items()}), Signals(owner, happens)

    def values(self, own: Equations, kinds: list[str], point: list[Array]) -> Values:
        """Return what equations of those `kinds`, as `own` states them, give at a `point`.

        Whether they write into their arguments is noted.
        """
        found: Values = {}
        for kind in kinds:
            given, before = self.arguments(point), self.arguments(point)
            with np.errstate(all="ignore"), running_errors(self.block, kind, float(given[0])):
                returned = getattr(own, kind)(*(given if kind == "on_event" else given[:4]))
                for name, value in checked(self.block, kind, returned).items():
                    found[kind, name] = np.array(value, dtype=float)
            for letter, now, then in zip("xup", given[1:4], before[1:4], strict=True):
                for name in (n for n in then if not _same(now[n], then[n])):
                    self.writes = (
                        f"{kind}() writes into its argument {letter}.{name}, which others read, too; return "
                        "a new array: np.where, np.concatenate, or a copy"
                    )
        return found

    def numbers(self) -> str:
        """See whether equations return what is declared, and finite numbers somewhere."""
        good, refused = list[tuple[list[Array], Values]](), list[TrussflowError]()
        self.points, points = [], self.points
        for point in points:
            happens = any(v.any() for v in self.arguments(point)[-1].values())
            kinds = [kind for kind in self.kinds if kind != "on_event" or happens]
            try:
                good.append((point, self.values(self.opened(), kinds, point)))
            except BlockError:
                raise
            except TrussflowError as error:
                refused.append(error)
        if not good:
            raise refused[0]
        self.points = [point for point, _ in good]
        remarks = (
            [f"{len(refused)} of {RANDOM_POINTS} random points are refused: {refused[0]}"] if refused else []
        )
        for kind, name in dict.fromkeys(key for _, each in good for key in each):
            values = [each[kind, name] for _, each in good if (kind, name) in each]
            may = kind == "indicators" or name in self.block.declared(Mode)
            finite = [np.isfinite(v) | (np.isinf(v) & may) for v in values]
            bad = sum(not each.all() for each in finite)
            where = f"{kind}(): '{name}' is not finite at"
            if bad == len(values):
                raise FaultError(
                    f"{where} any random point, such as {_listed(values[0])}; look for a division by zero, "
                    "the root or logarithm of a negative number, or say around= which numbers make sense"
                )
            remarks += [f"{where} {bad} of {len(values)} random points: is that outside its domain?"] * bool(
                bad
            )
        return "; ".join(remarks)

    def purity(self) -> str:
        """See whether equal arguments give equal numbers, whatever was computed meanwhile."""
        if self.writes:
            raise FaultError(self.writes)
        kinds = ["output"] if self.block.hides else self.kinds[:2]  # what is kept may change the others
        for first, second in pairwise([*self.points, self.points[0]]):
            own, fresh = self.opened(), self.opened()
            calls = (own, first), (own, second), (own, first), (fresh, first)
            once, _, *others = (self.values(each, kinds, point) for each, point in calls)
            for again in others:
                for kind, name in (key for key in once if not _same(once[key], again[key])):
                    raise FaultError(
                        f"{kind}(): '{name}' is {_listed(once[kind, name])}, then "
                        f"{_listed(again[kind, name])} for the same arguments: it draws at random, reads "
                        "a clock, or keeps something between calls. Declare what it keeps as a State, draw "
                        "with Noise; a Python block may return a Running from open()"
                    )
        return ""

    def tracing(self) -> str:
        """See whether it traces, to the numbers that NumPy gives."""
        if not self.block.traced:
            raise NotApplicableError("the block says traced = False, and runs in Python")
        block_check.isolate_anew(self.block)
        return ""

    def compiled(self) -> str:
        """See whether compiled code gives the numbers that NumPy gives."""
        if not self.block.traced:
            raise NotApplicableError("the block says traced = False, and runs in Python")
        system = flatten(self.block, external=True)
        try:
            prepared = Prepared.of(system, Solver(solver="RK45", backend="compiled"), None)
        except CompilationError as error:
            raise NotApplicableError(f"no C compiler works here: {error}") from None
        plan, chance = prepared.plan, np.random.default_rng(0)
        plain, p = NumPyExecutor(plan, prepared.quantities), plan.parameters(None)
        for quantity in [*prepared.quantities] * RANDOM_POINTS:
            t, x, d = chance.random(), chance.normal(size=plan.x.size), chance.normal(size=plan.d_size)
            d[plan.fired.span] = d[plan.fired.span] > 0.0
            with np.errstate(all="ignore"):
                expected = plain.call(quantity.name, t, x, d, p)
            found = prepared.traced.call(quantity.name, t, x, d, p)
            wrong = np.isfinite(expected) & ~near(found, expected, ROUND_OFF)
            if wrong.any():
                raise FaultError(
                    f"compiled code gives {_listed(found[wrong])}, NumPy {_listed(expected[wrong])} in "
                    f"'{quantity.name}' at t = {t:g} s: an operation there is sensitive to round-off"
                )
        return ""

    def feedthrough(self) -> str:
        """See whether outputs depend at once on what is declared, and on nothing else."""
        declared = block_check.isolate_anew(self.block).feedthrough
        depends = "; ".join(f"{y} on {', '.join(sorted(u)) or 'nothing'}" for y, u in declared.items())
        if self.block.traced:
            return f"at once depend {depends}" * bool(depends)
        real = {output: set[str]() for output in declared}
        for point, other in pairwise([*self.points, self.points[0]]):
            before = self.values(self.opened(), ["output"], point)
            for i, name in enumerate(self.shapes[1], 1 + len(self.shapes[0])):
                after = self.values(self.opened(), ["output"], [*point[:i], other[i], *point[i + 1 :]])
                for (_, output), value in before.items():
                    real[output] |= set() if _same(value, after["output", output]) else {name}
        shows = {output: tuple(sorted(seen)) for output, seen in real.items()}
        for output, seen in real.items():
            if missing := sorted(seen - declared[output]):
                raise FaultError(
                    f"output '{output}' changes at once with {', '.join(missing)}, which feedthrough() does "
                    f"not say: in a run it would see nothing there. Let feedthrough() return {shows}"
                )
        if all(declared[output] == seen for output, seen in real.items()):
            return ""
        told = (
            f"declared is that at once depend {depends}, but the numbers show less. Let feedthrough() return"
        )
        if type(self.block).feedthrough is Block.feedthrough:
            return f"{told} {shows}, if a loop is to be closed around the block"
        raise FaultError(f"{told} {shows}: what is declared without need makes algebraic loops")

    def units(self) -> str:
        """Tell what has no unit."""
        declared = {**self.block._declared, **self.block.extra_ports}.items()
        kinds = Input, Output, State, Parameter
        without = [
            n for n, d in declared if isinstance(d, kinds) and not isinstance(d, Mode) and d.unit is None
        ]
        return f"no unit is declared for {', '.join(without)}: wires there are not checked" * bool(without)


def _same(one: Array, other: Array) -> bool:
    """Tell whether numbers are equal to the bit, NaN to NaN."""
    return np.array_equal(one, other, equal_nan=True)


def near(found: Vector, expected: Vector, tolerance: float) -> Array:
    """Tell which elements of `found` and `expected` [any] agree to a `tolerance` [-].

    It is relative to the largest, or to one.
    """
    scale = max(1.0, float(np.abs(expected[np.isfinite(expected)]).max(initial=0.0)))
    return np.asarray((found == expected) | (np.abs(found - expected) <= tolerance * scale))


def _listed(value: Array) -> str:
    """Return numbers for a message."""
    return shown(np.round(value, 6).tolist())
