"""Summaries of objects as text and as HTML."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from html import escape

MAX_LINE_LENGTH = 110
"""Largest number of characters in a line of text."""


@dataclass(frozen=True, slots=True)
class Description:
    """Summary of an object: a `title`, `facts` by name, and the summaries of its `parts`.

    A fact is a text, or the cells of a row; the row without a name has the names of the columns.
    """

    title: str
    facts: Mapping[str, str | tuple[str, ...]] = field(default_factory=dict)
    parts: tuple[Description, ...] = ()

    def rows(self) -> list[tuple[str, ...]]:
        """Return the names of the facts with their cells."""
        return [
            (name, *([fact] if isinstance(fact, str) else fact))
            for name, fact in self.facts.items()
            if fact
        ]

    @property
    def head(self) -> str:
        """Text without the parts, with one fact per line."""
        rows = self.rows()
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ("  ".join(["", *map(str.ljust, row, widths)]).rstrip() for row in rows)
        return "\n".join([self.title, *lines])

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


class Described:
    """Base of objects with a summary, which `_described` returns."""

    __slots__ = ()

    def _described(self) -> Description:
        raise NotImplementedError

    def __repr__(self) -> str:
        described = self._described()
        return "\n".join([described.head, *described.tree()])

    def _repr_html_(self) -> str | None:
        described = self._described()
        text = f"<p>{escape(described.title)}</p><table>"
        for row in described.rows():
            tag = "td" if row[0] else "th"
            cells = (
                # Notebooks would align them to the right.
                f'<{tag} style="text-align: left">{escape(cell)}</{tag}>'
                for cell in row
            )
            text += f"<tr>{''.join(cells)}</tr>"
        return f"{text}</table>"
