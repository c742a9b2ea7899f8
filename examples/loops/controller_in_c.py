"""
A controller as C, for a flight computer
========================================

``kind="c"`` writes a source and a header without FMI, Python or memory allocation: an init and a step
function, and one function per input and output.
"""

from pathlib import Path

from trussflow.blocks import PD, Diagram, Saturation
from trussflow.fmu import export

law = Diagram("law")
pd, limit = law.add(pd=PD(20.0, 3.0, shape=3), limit=Saturation(-5.0, 5.0, shape=3))
pd.force >> limit.u
law.expose(
    position=pd.position,
    velocity=pd.velocity,
    goal=pd.reference_position,
    force=limit.y,
)
law.ground(pd.reference_velocity)
law.draw("law.svg")

# %%
export(law, "controller.c", kind="c", step=0.01)
header = Path("controller.h").read_text(encoding="utf-8")
print(header)
