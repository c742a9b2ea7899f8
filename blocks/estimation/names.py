"""States and signals of linear models by name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trussflow.blocks.framework.errors import NameLookupError
from trussflow.blocks.framework.system import Indices
from trussflow.blocks.framework.validation import shown
from trussflow.blocks.linear_analysis.references import label_of, split_index


def places(labels: Sequence[str], reference: str) -> Indices:
    """Return where ``"block.state"`` or ``"state[0:3]"`` is among labels such as ``block/state[0]``.

    Parameters
    ----------
    labels : sequence of str
        The labels, as linear models have them.
    reference : str
        What the user gave; the path may be left out where that leaves one.

    Raises
    ------
    NameLookupError
        If none or several are meant; the message lists those there are.
    """
    if not isinstance(reference, str):
        raise NameLookupError(f"name a state or signal as 'block.name', not {shown(reference)}")
    text, index = split_index(reference)
    wanted, groups = label_of(text), dict[str, list[int]]()
    for i, label in enumerate(labels):
        groups.setdefault(label.partition("[")[0], []).append(i)
    found = [wanted] if wanted in groups else [g for g in groups if g.endswith(f"/{wanted}")]
    if label_of(reference) in labels:  # one element, maybe of an array that is not all there
        return np.asarray(labels.index(label_of(reference)))
    if len(found) == 1:
        numbers = groups[found[0]]
        last = labels[numbers[-1]].partition("[")[2].rstrip("]")
        shape = tuple(int(i) + 1 for i in last.split(",")) if last else ()
        try:
            whole = np.reshape(numbers, shape)
            return whole if index is None else np.asarray(whole[index])
        except (IndexError, ValueError):
            pass
    raise NameLookupError(
        f"{f'{len(found)} arrays are' if len(found) > 1 else 'nothing is'} called '{reference}'; there are: "
        f"{', '.join(label.replace('/', '.') for label in labels)}"
    )
