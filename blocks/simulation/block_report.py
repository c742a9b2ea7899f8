"""Report on a block: the checks and their results."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from traceback import walk_tb

import numpy.typing as npt

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.described import Described, Description
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.errors import BlockError, TracingError, TrussflowError
from trussflow.blocks.framework.validation import by_name, shown
from trussflow.blocks.simulation.block_bench import Bench, FaultError, NotApplicableError
from trussflow.blocks.simulation.block_slopes import derivatives


@dataclass(frozen=True, slots=True, repr=False)
class BlockReport(Described):
    """Findings of `check_block`.

    Attributes
    ----------
    block : str
        Path and class of the block.
    findings : dict of str to str
        For each check ``"passed"``, ``"FAILED: ..."`` or ``"not applicable: ..."``, with what was found,
        where, and what to do.
    """

    block: str
    findings: dict[str, str]

    @property
    def failures(self) -> dict[str, str]:
        """The findings of the checks that failed."""
        return {name: text for name, text in self.findings.items() if text.startswith("FAILED")}

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
        return Description(f"{self.block}: {failed if self.failures else 'all is well'}", self.findings)


def check_block(
    block: Block, *, around: Mapping[str, npt.ArrayLike] | None = None, compiled: bool = True
) -> BlockReport:
    """Check a block of one's own by itself: what it declares, and what its equations do at random points.

    Parameters
    ----------
    block : Block
        The block. One whose shapes follow from wires is looked at as a scalar one, or as it is wired.
    around : mapping, optional
        States and inputs by name, for a block that computes near some numbers only: points are at most 0.1
        away from them. All others are up to 1 from zero [units as declared].
    compiled : bool
        Whether to compile it too, which takes a second. Native FMUs consist of the same C code.

    Returns
    -------
    BlockReport
        A finding for each check; its text says what to do.

    Raises
    ------
    BlockError
        If it is no block, or a diagram, whose blocks are to be checked one by one.

    Examples
    --------
    >>> from trussflow.blocks import TransferFunction, check_block
    >>> report = check_block(TransferFunction([1.0], [0.5, 1.0]), compiled=False)
    >>> report.raise_for_failures()
    >>> report.findings["feedthrough"]
    'passed: at once depend y on nothing'
    """
    given: object = block
    if not isinstance(given, Block) or isinstance(given, Diagram):
        raise BlockError(f"cannot check {shown(block)}: give one block, such as MyBlock()")
    item, findings = copy.deepcopy(block) if block.parent is None else block, dict[str, str]()
    bench = Bench(item, by_name("values around which to check", around))
    checks: dict[str, Callable[[], str]] = {
        "declarations": bench.declarations,
        "numbers": bench.numbers,
        "purity": bench.purity,
        "tracing": bench.tracing,
        **({"compiled": bench.compiled} if compiled else {}),
        "feedthrough": bench.feedthrough,
        "derivatives": partial(derivatives, bench),
        "units": bench.units,
    }
    for name, check in checks.items():
        try:
            told = check()
            findings[name] = f"passed: {told}" if told else "passed"
        except NotApplicableError as reason:
            findings[name] = f"not applicable: {reason}"
        except TracingError as error:
            findings[name] = f"FAILED: {error}" if name == "tracing" else "not applicable: it does not trace"
        except (FaultError, TrussflowError) as fault:
            findings[name] = f"FAILED: {fault}"
        except Exception as error:  # noqa: BLE001 - the block is the user's
            findings[name] = f"FAILED: {_raised(item, error)}"
        if not bench.points:  # nothing can be computed
            break
    return BlockReport(f"{item.path} ({type(item).__name__})", findings)


def _raised(block: Block, error: Exception) -> str:
    """Say which method of the user's `block` raised an `error` that no check expects."""
    frames = [frame for frame, _ in walk_tb(error.__traceback__)]
    users = [f for f in frames if not str(f.f_globals.get("__name__")).startswith("trussflow.blocks.")]
    method = (users or frames[-1:])[0].f_code.co_name
    return f"{method}() of block '{block.path}' raised {type(error).__name__}: {error}"
