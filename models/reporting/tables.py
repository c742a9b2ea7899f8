"""Tables for people to read: in a terminal, in Markdown and in HTML."""

from collections.abc import Sequence
from html import escape


def text_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table of left-aligned columns, a line under the header.

    Parameters
    ----------
    header : sequence of str
        One title per column.
    rows : sequence of sequence of str
        Their cells, as many as there are columns.

    Returns
    -------
    str
        Without a line break at the end.
    """
    lines = [header, *rows]
    widths = [max(len(line[i]) for line in lines) for i in range(len(header))]
    lines.insert(1, ["-" * width for width in widths])
    return "\n".join(
        "  ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown of `header` and `rows`, as for `text_table`."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def html_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in HTML of `header` and `rows`, as for `text_table`; it scrolls where it is too wide."""
    lines = [f"<th>{'</th><th>'.join(map(escape, header))}</th>"]
    lines += [f"<td>{'</td><td>'.join(map(escape, row))}</td>" for row in rows]
    return (
        f'<div class="scroll"><table><tr>{"</tr><tr>".join(lines)}</tr></table></div>'
    )
