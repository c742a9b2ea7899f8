"""
The paper, checked
==================

The statements of Li, Wei and Chen (2026) about their loop, compared with simulations. ``make reproduce`` runs
them and writes a report with every number in ``evidence.json``, from which this page is made. The report:
:doc:`/reproduction/README`.
"""

import json
import sys
import textwrap
from collections import Counter
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

docs = Path(sys.argv[0]).resolve().parents[1] / "docs"
evidence = json.loads((docs / "reproduction" / "evidence.json").read_text(encoding="utf-8"))
claims, numbers = evidence["claims"], evidence["numbers"]
verdicts = [verdict for verdict, _ in Counter(claim["verdict"] for claim in claims).most_common()]
sections = sorted({claim["section"] for claim in claims})
found = Counter((claim["section"], claim["verdict"]) for claim in claims)

_, axes = plt.subplots(figsize=(8, 3), layout="constrained")
left = np.zeros(len(sections))
for verdict in verdicts:
    count = np.array([found[section, verdict] for section in sections])
    axes.barh(range(len(sections)), count, left=left, label=f"{verdict}: {count.sum()}")
    left += count
axes.set_yticks(range(len(sections)), sections)
axes.set(xlabel="statements", ylabel="section")
axes.invert_yaxis()
axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))

# %%
# Statements that are not reproduced, in the words of the paper and of the report.

for claim in claims:
    if claim["verdict"] != "reproduced":
        told = f"we find: {claim['ours']}; {claim['why'] or claim['verdict']}"
        print(textwrap.fill(f"{claim['section']}: “{claim['quote']}”", 76))
        print(textwrap.indent(textwrap.fill(told, 72), "    "), end="\n\n")

# %%
# Comparison of the controllers as printed: peak position error of the root.

laws = {"proposed": "", "conventional": "-smc", "PD": "-pd"}
_, axes = plt.subplots(figsize=(7, 3), layout="constrained")
for case in (1, 2):
    errors = [numbers[f"case{case}{law}: peak position error"]["value"] for law in laws.values()]
    axes.bar(np.arange(len(laws)) + 0.4 * (case - 1.5), errors, 0.35, label=f"Case {case}")
axes.set_xticks(range(len(laws)), list(laws))
axes.set(yscale="log", ylabel="error [m]")
axes.legend()
plt.show()

# %%
# The paper's Figure 16 as simulated here, one of the figures of the report:
#
# .. image:: /reproduction/figure-16.png
#    :alt: Tracking errors under different controllers in Case 1
