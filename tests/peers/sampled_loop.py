"""
A sampled loop with a filter (ModelingToolkit)
==============================================

x' = -x + u under u = r - x, sampled every half second and held, where r is a sine behind a filter. From
sample to sample x goes by x_{k+1} = a x_k + (1 - a) u_k with a = exp(-1/2). ModelingToolkit:
``SampledData.md``.
"""

import numpy as np

from trussflow.blocks import (
    Diagram,
    DiscreteTransferFunction,
    Sine,
    StateSpace,
    ZeroOrderHold,
    simulate,
)

a, every = np.exp(-0.5), 0.5
loop = Diagram("loop")
goal, smooth = loop.add(
    goal=Sine(1.0, 1 / (2 * np.pi)),
    smooth=DiscreteTransferFunction([1 - a, 0], [1, -a], sample_time=every),
)
hold, plant = loop.add(
    hold=ZeroOrderHold(every),
    plant=StateSpace([[-1]], [[1]], [[1]], [[0]], initial_value=[1]),
)
goal >> smooth
smooth.y - plant.y[0] >> hold
hold.y >> plant.u[0]
result = simulate(loop, 20.0, step=0.01, log_step=every)
exact, filtered = [1.0], 0.0
for t in result["time"].values[:-1]:
    filtered = a * filtered + (1 - a) * np.sin(t)
    exact.append(a * exact[-1] + (1 - a) * (filtered - exact[-1]))
error = abs(result["plant.y"][:, 0].values - exact).max()
print(f"largest error at the samples {error:.1e}")
assert error < 1e-9
