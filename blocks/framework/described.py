"""What an engineer wants to know of an object at one glance, as text and in notebooks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from trussflow.blocks.framework.block import Block

WIDTH = 110
"""Letters in a line of text."""


@dataclass(frozen=True, slots=True)
class Description:
    """A `title`, `facts` by name, and the descriptions of `parts`."""

    title: str
    facts: dict[str, str] = field(default_factory=dict)
    parts: tuple[Description, ...] = ()

    @property
    def head(self) -> str:
        """The text without parts: a fact in each line."""
        margin = max(map(len, self.facts), default=0) + 2
        return "\n".join(
            [self.title, *(f"  {name:{margin}}{fact}" for name, fact in self.facts.items() if fact)]
        )

    def tree(self, indent: str = "") -> Iterator[str]:
        """Return the parts as a tree behind an `indent`, with a line for each."""
        for i, part in enumerate(self.parts, 1):
            fork, below = ("├─", "│  ") if i < len(self.parts) else ("└─", "   ")
            line = f"{indent}{fork} {part.title}"
            line += "".join(f"; {name} {fact}" for name, fact in part.facts.items() if fact)
            yield line if len(line) <= WIDTH else f"{line[: WIDTH - 1]}…"
            yield from part.tree(indent + below)

    def html(self, *, unfolded: bool = True) -> str:
        """Return the same as HTML, `unfolded` or not: parts unfold at a click."""
        cell = '<td style="text-align:left">'
        rows = (f"<tr>{cell}{escape(n)}</td>{cell}{escape(f)}</td></tr>" for n, f in self.facts.items() if f)
        inner = "".join(part.html(unfolded=False) for part in self.parts)
        unfold = ' open=""' * unfolded
        return (
            f'<details{unfold} style="margin-left:1em"><summary>{escape(self.title)}</summary>'
            f"<table>{''.join(rows)}</table>{inner}</details>"
        )


class Described:
    """Base of what describes itself; `_described` says how."""

    __slots__ = ()

    def _described(self) -> Description:
        raise NotImplementedError

    def __repr__(self) -> str:
        described = self._described()
        return "\n".join([described.head, *described.tree()])

    def _repr_html_(self) -> str:
        return self._described().html()


def described_block(block: Block) -> Description:
    """Return the rate, ports, states and parameters of a `block`, which need not be built to its end."""
    kind = type(block).__name__
    if "ports" not in vars(block):
        return Description(f"{kind}, not built yet")
    offset = f" from {block.sample_offset:g} s" if block.sample_offset else ""
    facts = {
        "sampled": "" if block.sample_time is None else f"every {block.sample_time:g} s{offset}",
        "in": ", ".join(port.summary for port in block.inputs()),
        "out": ", ".join(port.summary for port in block.outputs()),
        "states": ", ".join(n + (f" [{s.unit}]" if s.unit else "") for n, s in block.states().items()),
        "parameters": ", ".join(
            f"{name} {value.shape}" if value.ndim else f"{name} = {value:g}"
            for name, value in block.parameters.items()
        ),
    }
    return Description(kind if block.name == kind else f"{block.name}: {kind}", facts)
