"""Calling the equations of a block: what they return is checked, what they raise explained."""

from __future__ import annotations

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.errors import BlockError, Explained, SimulationError, TracingError
from trussflow.blocks.tracing.tracing import shape_of


def checked(block: Block, kind: str, values: Values) -> Values:
    """Return `values`, if names and shapes are what the equation `kind` of a `block` must return."""
    where = f"{kind}() of block '{block.path}' ({type(block).__name__})"
    if kind == "output":
        expected = {p.name: p.whole_shape for p in block.outputs()}
    else:
        expected = {name: block.state_shape(name) for name in block.states()}
    returned: object = values
    some = kind == "on_event"  # those that jump
    if (
        not isinstance(returned, dict)
        or not set(returned) <= set(expected)
        or (set(returned) != set(expected) and not some)
    ):
        got = ", ".join(returned) if isinstance(returned, dict) else repr(type(returned).__name__)
        raise BlockError(
            f"{where} must return a dict of{' some of' if some else ''}: {', '.join(expected)}; "
            f"it returned: {got}"
        )
    for name in returned:
        shape = expected[name]
        if shape_of(values[name]) != shape:
            raise BlockError(
                f"{where}: '{name}' is declared with shape {shape}, but was returned with shape "
                f"{shape_of(values[name])}"
            )
    return values


def tracing_errors(block: Block) -> Explained:
    """Turn whatever a block's equations raise while traced into one clear error."""
    return Explained(lambda error: refusal(block, f"{type(error).__name__}: {_brief(error)}"))


def _brief(error: Exception) -> str:
    """Return the first line of a message, or two where the first only leads up to the second."""
    first, *others = str(error).splitlines() or [""]
    return f"{first} {others[0]}" if others and first.endswith(":") else first


def running_errors(block: Block, kind: str, t: float | None) -> Explained:
    """Make one clear error of what the equation `kind` of a `block` raises at time `t` [s]."""
    return Explained(
        lambda error: SimulationError(
            f"{kind}() of block '{block.path}' ({type(block).__name__}) raised "
            f"{type(error).__name__}{'' if t is None else f' at t = {t:g} s'}: {error}"
        )
    )


def refusal(block: Block, reason: str) -> TracingError:
    """Return the error that says for which `reason` the equations of a `block` cannot be traced."""
    return TracingError(
        f"the equations of block '{block.path}' ({type(block).__name__}) cannot be traced: "
        f"{reason}\n"
        "  use np.where instead of 'if', np.logical_and instead of 'and' or '&', np.stack instead "
        "of np.array or of writing into an array; or make it a Python block"
    )
