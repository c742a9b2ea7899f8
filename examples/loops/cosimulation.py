"""
Co-simulation of FMUs
=====================

Two FMUs coupled at communication points: coupling schemes, error-controlled steps, and SSP export.
"""

import numpy as np

from trussflow.blocks import Diagram, StateSpace, cosimulate, simulate
from trussflow.fmu import Fmu, export
from trussflow.fmu.ssp import export_ssp, import_ssp


def arm():
    """Return a lightly damped oscillator: force [N] to position [m]."""
    return StateSpace(
        [[0.0, 1.0], [-9.0, -0.6]],
        [[0.0], [1.0]],
        [[1.0, 0.0]],
        [[0.0]],
        initial_value=[1.0, 0.0],
        input_unit="N",
        output_unit="m",
    )


def law():
    """Return a lag with direct feedthrough: position [m] to force [N]."""
    return StateSpace(
        [[-2.0]], [[1.0]], [[3.0]], [[-1.5]], input_unit="m", output_unit="N"
    )


def loop(plant, controller):
    """Return a loop of the two; each may be a block or an FMU."""
    diagram = Diagram("arm with law")
    diagram.add(arm=plant, law=controller)
    plant.y >> controller.u
    controller.y >> plant.u
    return diagram


export(arm(), "arm.fmu", step=1e-3)
export(law(), "law.fmu", step=1e-3)
loop(arm(), law()).draw("arm_with_law.svg")
whole = simulate(loop(arm(), law()), 5.0, step=1e-4)["arm.y"]

for coupling in ("jacobi", "gauss-seidel", "iterate"):
    result = cosimulate(
        loop(Fmu("arm.fmu"), Fmu("law.fmu")), 5.0, step=0.01, coupling=coupling
    )
    error = float(
        np.abs(result["arm.y"] - whole.sel(time=result["time"], method="nearest")).max()
    )
    print(f"{coupling:12s}: error {error:.1e} m at 10 ms")

result = cosimulate(
    loop(Fmu("arm.fmu"), Fmu("law.fmu")), 5.0, step=2e-4, tolerance=1e-2
)
error = float(
    np.abs(result["arm.y"] - whole.sel(time=result["time"], method="nearest")).max()
)
print(
    f"tolerance 1 %: error {error:.1e} m with {result.attrs['communication_steps']} steps"
)

export_ssp(loop(Fmu("arm.fmu"), Fmu("law.fmu")), "loop.ssp", step=0.01)
again = cosimulate(import_ssp("loop.ssp"), 5.0, step=0.01)
print("from SSP, final position", float(again["arm.y"][-1, 0]), "m")
