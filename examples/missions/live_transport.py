"""
The paper's loop as a live page
===============================

One HTML file that simulates Case 1 in any browser: the flexible truss with its controller, compiled to
WebAssembly. Sliders change gains and trajectory; each change repeats the run.
"""

from pathlib import Path

from trussflow.models import SpaceTruss
from trussflow.models.transport import Mission, transport_diagram

loop = transport_diagram(Mission.of_case(1), SpaceTruss.published())
page = Path("transport.html")
loop.live(
    page,
    parameters=["observer.gain", "controller.mu", "controller.beta"],
    signals=[loop.truss.task_position[0:3], "truss.modal_coordinate", "truss.energy"],
    duration=10.0,
    step=2e-3,
)
print(f"{page}: {page.stat().st_size / 1e6:.2f} MB")
