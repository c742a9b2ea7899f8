"""Summaries of objects as text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

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


class Described:
    """Base of objects with a summary, which `_described` returns."""

    __slots__ = ()

    def _described(self) -> Description:
        raise NotImplementedError

    def __repr__(self) -> str:
        described = self._described()
        return "\n".join([described.head, *described.tree()])
