"""Summaries of objects as text and as HTML."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from html import escape

MAX_LINE_LENGTH = 110
"""Largest number of characters in a line of text."""

LEFT_ALIGNED = 'style="text-align: left"'
"""Attribute of table cells, as notebooks align them to the right."""


@dataclass(frozen=True, slots=True)
class Description:
    """Summary of an object: a `title`, `facts` by name, and the summaries of its `parts`.

    A `table` has cells by the names of row and column; all rows have the same columns.
    """

    title: str
    facts: dict[str, str] = field(default_factory=dict)
    parts: tuple[Description, ...] = ()
    table: dict[str, dict[str, str]] = field(default_factory=dict)

    def _tables(self) -> Iterator[list[list[str]]]:
        """Yield the rows of cells of the facts and of the table, if any."""
        facts = [[name, fact] for name, fact in self.facts.items() if fact]
        rows = [[name, *row.values()] for name, row in self.table.items()]
        columns = [["", *row] for row in self.table.values()][:1]
        yield from filter(None, (facts, columns + rows))

    @property
    def head(self) -> str:
        """Text without the parts, with one fact or row per line."""
        lines = [self.title]
        for table in self._tables():
            widths = [max(map(len, column)) for column in zip(*table, strict=True)]
            for row in table:
                cells = (f"  {c:{w}}" for c, w in zip(row, widths, strict=True))
                lines.append("".join(cells).rstrip())
        return "\n".join(lines)

    @property
    def html(self) -> str:
        """HTML with tables of the facts and rows, and a list of the parts."""
        text = f"<p>{escape(self.title)}</p>"
        for table in self._tables():
            text += "<table>"
            for name, *cells in table:
                tag = "td" if name else "th"  # the row of column names has no name
                row = "".join(
                    f"<{tag} {LEFT_ALIGNED}>{escape(c)}</{tag}>" for c in cells
                )
                text += f"<tr><th {LEFT_ALIGNED}>{escape(name)}</th>{row}</tr>"
            text += "</table>"
        parts = "".join(f"<li>{part.html}</li>" for part in self.parts)
        return f"{text}<ul>{parts}</ul>" if parts else text

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
        return self._described().html
