"""
A ball in a round bowl (PathSim)
================================

A point falls inside a circle of radius 1 and is reflected where it hits the wall. Its energy stays, and the
first hit is after a free fall of 1/2 + √3/2. PathSim: ``example_billards_sphere.py``.
"""

import numpy as np

from trussflow.blocks import Block, Diagram, Event, Mode, Output, State, simulate


class Ball(Block):
    """A point in a bowl."""

    energy, hits = Output(), Output()
    r, v = State(2, initial=[0.5, 0.5]), State(2)
    hit, count, first = Event("rising"), Mode(), Mode()

    def output(self, t, x, u, p):
        """Return the energy and the time of the first hit."""
        return {"energy": x.v @ x.v / 2 + 9.81 * x.r[1], "hits": x.count}

    def derivative(self, t, x, u, p):
        """Fall."""
        return {"r": x.v, "v": np.array([0.0, -9.81])}

    def indicators(self, t, x, u, p):
        """Return the distance of the point beyond the wall."""
        return {"hit": x.r @ x.r - 1.0}

    def on_event(self, t, x, u, p, fired):
        """Reflect."""
        n = x.r / np.sqrt(x.r @ x.r)
        first = np.where(x.count > 0, x.first, t)
        return {
            "r": n,
            "v": x.v - 2 * (x.v @ n) * n,
            "count": x.count + 1,
            "first": first,
        }


bowl = Diagram("bowl")
bowl.add(ball=Ball())
log = ["ball.energy", "ball.hits", "ball.first"]
result = simulate(bowl, 7.0, step=0.01, log=log)
late = float(result["ball.first"][-1]) - np.sqrt((1 + np.sqrt(3)) / 9.81)
lost = np.ptp(result["ball.energy"].values)
print(
    f"{int(result['ball.hits'][-1])} hits, the first {late:.1e} s late; energy varies by {lost:.1e}"
)
assert abs(late) < 1e-12
assert lost < 1e-10
