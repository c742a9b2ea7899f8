r"""
Sweeps: a thousand runs, and the worst one repeated
===================================================

Parameters are inputs of the compiled code, so new values need no compilation. ``sweep`` samples them, runs
the diagram in worker processes, and keeps selected results of each run.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy import stats

from trussflow.blocks import (
    Constant,
    Diagram,
    Gain,
    Integrator,
    Noise,
    Sum,
    rerun,
    sweep,
)

loop = Diagram("second order")
goal, error, stiffness, damping, gust, speed, place = loop.add(
    goal=Constant(1.0),
    error=Sum("+--+"),
    stiffness=Gain(1.0),
    damping=Gain(0.8),
    gust=Noise(0.1, 0.2, seed=0),
    speed=Integrator(),
    place=Integrator(),
)
goal.y >> error.u1
place.y >> stiffness >> error.u2
speed.y >> damping >> error.u3
gust >> error.u4
error >> speed >> place
loop.draw("second_order.svg")

# %%
# Each parameter has a distribution; parameters in a tuple are correlated. The noise has a different seed in
# each run:

swept = sweep(
    loop,
    20.0,
    vary={
        "damping.gain": stats.truncnorm(-3, 3, loc=0.8, scale=0.15),
        ("stiffness.gain", "goal.value"): stats.multivariate_normal(
            [1, 1], [[0.02, 0.005], [0.005, 0.01]]
        ),
        "speed.integral": stats.uniform(-0.2, 0.4),
        "gust.seed": stats.randint(0, 2**31),
    },
    samples=1000,
    method="latin",
    keep={
        "highest": ("place.y", "max"),
        "settled": ("place.y", "settling"),
        "place.y": "final",
    },
    step=1e-2,
)
print(swept["status"].to_series().value_counts().to_string())
print(swept[["highest", "place.y"]].quantile([0.05, 0.5, 0.95]).to_dataframe().round(3))

# %%
# The varied values are coordinates of the result. The worst run is repeated, bit by bit, with all of its
# signals:

worst = int(np.argmax(swept["highest"].values))
result = rerun(loop, swept, worst)
assert float(result["place.y"].max()) == float(swept["highest"][worst])

fig, (left, right) = plt.subplots(1, 2, figsize=(9, 3.5), layout="constrained")
points = left.scatter(swept["damping.gain"], swept["highest"], 6, swept["goal.value"])
left.set(xlabel="damping", ylabel="highest position")
fig.colorbar(points, label="goal")
right.plot(result["time"], result["place.y"])
right.set(xlabel="time [s]", ylabel="position", title=f"sample {worst}, the worst")
plt.show()

# %%
# ``path="folder"`` keeps finished runs, and the same call continues after an interruption.
# ``executor=client.get_executor()`` uses the workers of a Dask cluster.
