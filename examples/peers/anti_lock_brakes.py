"""
Anti-lock brakes (PathSim)
==========================

A car of 1500 kg, one braked wheel; brakes open where the slip exceeds 0.17, and close where it falls below
0.13. Wheel and car together obey M v + J ω / R = their initial value less the impulse of the brakes. The
friction is Pacejka's: μ = sin(1.9 arctan(10 λ)). PathSim: ``example_abs_braking.py``.
"""

import numpy as np

from trussflow.blocks import Diagram, Integrator, Relay, as_block, simulate

M, R, J, load, torque = 1500.0, 0.3, 1.0, 1500.0 * 9.81 / 4, 2000.0


@as_block
def slip(v, w):
    """Return the slip of the wheel."""
    return np.clip((v - R * np.maximum(w, 0.0)) / np.maximum(v, 0.1), 0.0, 1.0)


car = Diagram("car")
v, w, taken = car.add(v=Integrator(30.0), w=Integrator(30.0 / R), taken=Integrator())
brake = car.add(brake=Relay(0.17, 0.13, on=0.0, off=torque))
slipping = slip(v, w)
slipping >> brake >> taken
friction = load * np.sin(1.9 * np.arctan(10.0 * slipping.y))
-friction / M >> v
(R * friction - brake.y) / J >> w
result = simulate(car, 5.0, step=1e-3, log=["v.y", "w.y", "taken.y", "slip_1.y"])
kept = (M * result["v.y"] + (J * result["w.y"] + result["taken.y"]) / R).values
slips = result["slip_1.y"].sel(time=slice(0.5, None)).values
print(
    f"slip from {slips.min():.4f} to {slips.max():.4f}, impulse varies by {np.ptp(kept):.1e} N s"
)
assert np.ptp(kept) < 1e-7
assert 0.129 < slips.min() < slips.max() < 0.171
