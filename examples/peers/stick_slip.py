"""
A box that sticks and slips on a belt (PathSim)
===============================================

A belt goes to and fro under a box that a spring and a damper hold; dry friction carries it along until
they pull harder. The time of the first slip has an equation; while it sticks, the box moves as the belt.
PathSim: ``example_stickslip_event.py``.
"""

import numpy as np
from scipy.optimize import brentq

from trussflow.blocks import Block, Diagram, Event, Mode, Output, State, simulate

m, k, d, friction, top, w = 20.0, 70.0, 10.0, 1.5 * 20.0 * 9.81, 2.0, 2 * np.pi / 50.0


def pull(t, x):
    """Return the friction force that lets the box move as the belt [N]."""
    return k * x + d * top * np.sin(w * t) + m * top * w * np.cos(w * t)


class Box(Block):
    """Box with its velocity relative to the belt."""

    velocity, position = Output(unit="m/s"), Output(unit="m")
    x, slide = State(), State()
    way, last_slip = Mode(meaning="1 or -1: where it slides, 0 while it sticks"), Mode()
    slips, sticks = Event("rising"), Event("falling")

    def output(self, t, x, u, p):
        """Return position and velocity."""
        return {"velocity": x.slide + top * np.sin(w * t), "position": x.x}

    def derivative(self, t, x, u, p):
        """Return the rates while sliding or sticking."""
        force = -pull(t, x.x) - d * x.slide - x.way * friction
        return {
            "x": x.slide + top * np.sin(w * t),
            "slide": np.where(x.way == 0, 0.0, force / m),
        }

    def indicators(self, t, x, u, p):
        """Slip when friction is too weak, stick when sliding ends."""
        stuck = x.way == 0
        return {
            "slips": np.where(stuck, np.abs(pull(t, x.x)) - friction, -1.0),
            "sticks": np.where(stuck, -1.0, x.way * x.slide),
        }

    def on_event(self, t, x, u, p, fired):
        """Begin to slip or to stick."""
        way = np.where(fired.slips, -np.sign(pull(t, x.x)), 0.0)
        return {
            "slide": 0.0,
            "way": way,
            "last_slip": np.where(fired.slips, t, x.last_slip),
        }


bench = Diagram("bench")
bench.add(box=Box())
result = simulate(bench, 100.0, step=0.01, log=["box.last_slip"])
slips = np.unique(result["box.last_slip"])[1:]
exact = brentq(lambda t: pull(t, top / w * (1 - np.cos(w * t))) - friction, 0.0, 12.0)
print(f"first of {slips.size} slips after {slips[0]:.9f} s, exactly {exact:.9f} s")
assert abs(slips[0] - exact) < 1e-9
