"""
A diode and a resistor (PathSim)
================================

Current and voltage of the diode depend on each other at once: i = I (exp(v / V) - 1), v = e - R i. The
solution is Wright's function of (e + R I) / V + ln(R I / V). PathSim: ``example_diode.py``.
"""

import numpy as np
from scipy.special import wrightomega

from trussflow.blocks import Diagram, Sine, Sum, as_block, simulate

R, saturation, V = 1000.0, 1e-12, 0.026


@as_block
def diode(v):
    """Return the current [A]."""
    return saturation * (np.exp(v / V) - 1.0)


circuit = Diagram("circuit", loops="solve")
source, voltage = circuit.add(source=Sine(5.0), voltage=Sum("+-"))
source.y >> voltage.u1
R * diode(voltage).y >> voltage.u2
result = simulate(circuit, 2.0, step=0.01)
e = result["source.y"] + R * saturation
i = V / R * wrightomega(e / V + np.log(R * saturation / V)) - saturation
error = float(abs(result["diode_1.y"] - i).max())
print(f"largest error of the current {error:.1e} A, of {float(i.max()):.2e} A")
assert error < 1e-12
