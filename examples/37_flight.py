"""
Robustness limits of the controllers
====================================

The largest value of each imperfection that a controller tolerates, with everything else exact. ``make
flight`` finds it by bisection for the paper's controller, its mode-neutral form, and the mean-axes
controller, and runs the last one on hundreds of uncertain trusses. The numbers are read from
``evidence.json``; the report is :doc:`/flight/README`.
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
# A dot is the largest tolerated value, a cross the smallest value with a failed run; without a cross no tried
# value failed. Hold time and delay separate the controllers most.

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
# Mean-axes control of random trusses with realistic sensors and actuators: distribution of the peak values.
#
# .. image:: /flight/draws.png
#    :alt: Distribution of the samples
