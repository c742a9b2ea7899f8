"""What an engineer wants to know of an object at one glance, as text and in notebooks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from html import escape

WIDTH = 110
"""Letters in a line of text."""


@dataclass(frozen=True, slots=True)
class Description:
    """A title, facts by name, and the descriptions of parts."""

    title: str
    facts: dict[str, str] = field(default_factory=dict)
    parts: tuple[Description, ...] = ()

    def lines(self) -> Iterator[str]:
        """Return the text: a fact in each line, and the parts as a tree with a line for each."""
        facts = {name: fact for name, fact in self.facts.items() if fact}
        yield self.title
        margin = max(map(len, facts), default=0) + 2
        yield from (f"  {name:{margin}}{fact}" for name, fact in facts.items())
        yield from self._tree("")

    def _tree(self, indent: str) -> Iterator[str]:
        for i, part in enumerate(self.parts, 1):
            facts = "".join(f"; {name} {fact}" for name, fact in part.facts.items() if fact)
            line, last = f"{indent}{'└─' if i == len(self.parts) else '├─'} {part.title}{facts}", i == len(self.parts)
            yield line if len(line) <= WIDTH else f"{line[: WIDTH - 1]}…"
            yield from part._tree(indent + ("   " if last else "│  "))

    def html(self, *, unfolded: bool = True) -> str:
        """Return the same as HTML: parts unfold at a click."""
        cell = '<td style="text-align:left">'
        rows = (f"<tr>{cell}{escape(n)}</td>{cell}{escape(f)}</td></tr>" for n, f in self.facts.items() if f)
        inner = "".join(part.html(unfolded=False) for part in self.parts)
        return (
            f'<details{" open" * unfolded} style="margin-left:1em"><summary>{escape(self.title)}</summary>'
            f"<table>{''.join(rows)}</table>{inner}</details>"
        )


class Described:
    """Base of what describes itself; `_described` says how."""

    __slots__ = ()

    def _described(self) -> Description:
        raise NotImplementedError

    def __repr__(self) -> str:
        return "\n".join(self._described().lines())

    def _repr_html_(self) -> str:
        return self._described().html()
