"""Summaries of objects, as text and as HTML for notebooks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from trussflow.blocks.framework.block import Block

MAX_LINE_LENGTH = 110
"""Largest number of characters in a line of text."""


@dataclass(frozen=True, slots=True)
class Description:
    """Summary of an object: a `title`, `facts` by name, and the summaries of its `parts`."""

    title: str
    facts: dict[str, str] = field(default_factory=dict)
    parts: tuple[Description, ...] = ()

    @property
    def head(self) -> str:
        """Text without the parts, with one fact per line."""
        margin = max(map(len, self.facts), default=0) + 2
        return "\n".join(
            [
                self.title,
                *(
                    f"  {name:{margin}}{fact}"
                    for name, fact in self.facts.items()
                    if fact
                ),
            ]
        )

    def tree(self, indent: str = "") -> Iterator[str]:
        """Yield the lines of the tree of parts, after an `indent`."""
        for i, part in enumerate(self.parts, 1):
            fork, below = ("├─", "│  ") if i < len(self.parts) else ("└─", "   ")
            line = f"{indent}{fork} {part.title}"
            line += "".join(
                f"; {name} {fact}" for name, fact in part.facts.items() if fact
            )
            yield (
                line
                if len(line) <= MAX_LINE_LENGTH
                else f"{line[: MAX_LINE_LENGTH - 1]}…"
            )
            yield from part.tree(indent + below)

    def html(self, *, unfolded: bool = True) -> str:
        """Return the summary as HTML, `unfolded` or not; the parts are folded."""
        cell = '<td style="text-align:left">'
        rows = (
            f"<tr>{cell}{escape(n)}</td>{cell}{escape(f)}</td></tr>"
            for n, f in self.facts.items()
            if f
        )
        inner = "".join(part.html(unfolded=False) for part in self.parts)
        unfold = ' open=""' * unfolded
        return (
            f'<details{unfold} style="margin-left:1em"><summary>{escape(self.title)}</summary>'
            f"<table>{''.join(rows)}</table>{inner}</details>"
        )


class Described:
    """Base of objects with a summary, which `_described` returns."""

    __slots__ = ()

    def _described(self) -> Description:
        raise NotImplementedError

    def __repr__(self) -> str:
        described = self._described()
        return "\n".join([described.head, *described.tree()])

    def _repr_html_(self) -> str:
        return self._described().html()


def described_block(block: Block) -> Description:
    """Return the summary of a `block`: rate, ports, states, parameters; the block may be incomplete."""
    kind = type(block).__name__
    if "ports" not in vars(block):
        return Description(f"{kind}, not built yet")
    offset = f" from {block.sample_offset:g} s" if block.sample_offset else ""
    facts = {
        "sampled": ""
        if block.sample_time is None
        else f"every {block.sample_time:g} s{offset}",
        "in": ", ".join(port.summary for port in block.inputs()),
        "out": ", ".join(port.summary for port in block.outputs()),
        "states": ", ".join(
            n + (f" [{s.unit}]" if s.unit else "") for n, s in block.states().items()
        ),
        "parameters": ", ".join(
            f"{name} {value.shape}" if value.ndim else f"{name} = {value:g}"
            for name, value in block.parameters.items()
        ),
    }
    return Description(kind if block.name == kind else f"{block.name}: {kind}", facts)
