"""
Proportional and integral control (bdsim)
=========================================

A lag of two seconds under 10 e + 3 ∫ e follows a step as (5 s + 3/2) / (2 s² + 6 s + 3/2) does, whose
response python-control computes by matrix exponentials. bdsim: ``pid.py``.
"""

import control

from trussflow.blocks import PID, Diagram, Step, TransferFunction, simulate

loop = Diagram("loop")
goal, pid, plant = loop.add(
    goal=Step(0.0), pid=PID(10.0, 3.0), plant=TransferFunction([0.5], [2.0, 1.0])
)
goal >> pid.reference
plant >> pid.measurement
pid >> plant
result = simulate(loop, 10.0, step=0.005)
exact = control.step_response(
    control.tf([5.0, 1.5], [2.0, 6.0, 1.5]), result["time"].values
).outputs
error = float(abs(result["plant.y"] - exact).max())
print(f"largest error {error:.1e}")
assert error < 1e-9
