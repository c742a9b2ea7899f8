"""
The truss and its modes
=======================

The truss of the paper: point masses, grasp points, and the first six modes, which represent its flexibility.
"""

import matplotlib.pyplot as plt
import numpy as np

from trussflow.models import TrussModes

truss = TrussModes.reconstructed()
print(f"{truss.masses.sum():.0f} kg in {truss.masses.size} point masses; frequencies [Hz]:")
print(truss.frequencies[:6].round(3))

figure, axes = plt.subplots(2, 3, subplot_kw={"projection": "3d"}, figsize=(9, 6), layout="constrained")
for k, axis in enumerate(axes.flat):
    shape = truss.shapes[:, :, k]
    moved = truss.positions + 2.0 / abs(shape).max() * shape
    axis.scatter(*truss.positions.T, s=2, color="lightgrey")
    axis.scatter(*moved.T, s=6, c=np.linalg.norm(shape, axis=1), cmap="viridis")
    axis.scatter(*truss.grasp_positions.T, marker="^", color="tab:red")
    axis.set(title=f"{truss.frequencies[k]:.2f} Hz", xticks=[], yticks=[], zticks=[])
    axis.set_box_aspect(np.ptp(truss.positions, axis=0) + 2.0)
plt.show()
