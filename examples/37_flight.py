"""
What flies, and where loops end
===============================

How much of each imperfection does a loop take, alone, while all else is exact? ``make flight`` finds it by
bisection, for the paper's law, for its form that leaves the modes alone, and for the loop of the mean axes,
and flies the last on hundreds of trusses that it does not know. The numbers here are read from what that
writes, ``evidence.json``; how they came about is told in :doc:`/flight/README`.
"""

import json
import re
import sys
from math import nan
from pathlib import Path

import matplotlib.pyplot as plt

docs = Path(sys.argv[0]).resolve().parents[1] / "docs"
numbers = json.loads((docs / "flight" / "evidence.json").read_text(encoding="utf-8"))["numbers"]
ends: dict[str, dict[str, dict[str, float]]] = {}
for name, number in numbers.items():
    if parts := re.fullmatch(r"(.+) by (.+), (flies|lost)", name):
        what, law, end = parts.groups()
        ends.setdefault(f"{what} [{number['unit']}]", {}).setdefault(law, {})[end] = number["value"]

# %%
# A dot is the worst that is flown, a cross the next that is lost; without a cross, nothing that was tried is.
# What decides is how long commands are held, and how late they come.

laws = list(dict.fromkeys(law for each in ends.values() for law in each))
_, grid = plt.subplots(
    -(-len(ends) // 2), 2, figsize=(9, 0.9 * len(ends)), squeeze=False, layout="constrained"
)
for axes, (what, by_law) in zip(grid.flat, ends.items(), strict=False):
    scale = 100.0 if what.endswith("[%]") else 1.0
    for row, law in enumerate(laws):
        end = by_law.get(law)
        if end is None:
            axes.text(0.0, row, " not flown", va="center")
        else:
            axes.plot(scale * end.get("flies", nan), row, f"C{row}o", clip_on=False)
            axes.plot(scale * end.get("lost", nan), row, "kx", clip_on=False)
    axes.set_yticks(range(len(laws)), laws)
    axes.set(xlabel=what, ylim=(len(laws) - 0.5, -0.5), xlim=(0.0, None))
for axes in grid.flat[len(ends) :]:
    axes.remove()
plt.show()

# %%
# The loop of the mean axes on trusses drawn at random, behind sensors and actuators as they are: how the
# greatest values of its flights are spread.
#
# .. image:: /flight/draws.png
#    :alt: How the draws are spread
