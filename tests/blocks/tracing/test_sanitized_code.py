"""The code of simulations under the address and undefined-behaviour sanitizers."""

import os
import subprocess
import sys

import campaign
import pytest

LOOP_SCRIPT = """
import numpy as np
from trussflow.blocks.tracing import compiler
compiler.FLAGS = (*compiler.FLAGS, "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
from trussflow.blocks import *
from trussflow.blocks.errors import DivergenceError

diagram = Diagram("all")
state, table = diagram.add(state=Integrator(np.ones(3)), table=Table([0.0, 1.0, 2.0], [0.0, -2.0, 1.0]))
hold = diagram.add(hold=ZeroOrderHold(0.02))
delay = diagram.add(delay=UnitDelay(0.03).sampled(every=0.03, offset=0.01))
state >> hold >> delay >> state
state.y[0] >> table.u
for solver in ("rk4", "euler"):
    for log_step in (0.01, 0.05):
        simulate(diagram, 1.0, step=0.01, solver=solver, log_step=log_step, backend="compiled")
relay, turn, fall = diagram.add(relay=Relay(0.1, -0.1), turn=Gain(-1.0), fall=Integrator(0.5))
fall >> relay >> turn >> fall
for solver in ("RK45", "DOP853", "Rodas5P", "auto"):
    simulate(diagram, 1.0, solver=solver, backend="compiled", progress=False)
"""

OTHER_SCRIPT = """
growth = Diagram("growth")
x = growth.add(x=Integrator(1.0))
f = growth.add(f=Function(lambda u: u**3, {"u": Input()}, {"y": Output()}))
x >> f >> x
try:
    simulate(growth, 10.0, step=0.1, backend="compiled", progress=False)
except DivergenceError:
    print("diverged")

class Ring(Block):
    x = State(7, initial=0.1)
    y = Output(7)
    def output(self, t, x, u, p):
        return {"y": x.x}
    def derivative(self, t, x, u, p):
        def one(a, b):
            return (np.sin(a) * np.cos(b) - np.exp(-a * a) - np.log(a) * 1e-9 + (2.0 + b) ** 1.5,)

        rates = repeated(one, [(x.x[i], x.x[i - 1]) for i in range(7)])
        return {"x": np.stack([rate for (rate,) in rates])}

ring = Diagram("ring")
ring.add(ring=Ring())
for start in (0.1, 1e-310, 1e300, -1.0):  # the last two end in infinities and NaN
    try:
        simulate(ring, 0.1, step=1e-3, initial={"ring.x": start}, backend="compiled", progress=False)
    except DivergenceError:
        print("diverged")
allocation = Diagram("allocation")
bounded = RateBoundedAllocation(3, np.full(6, 0.1), np.full(6, 5.0), 0.1)
wave, one, metric, low, high = allocation.add(
    wave=Sine([4.0, -3.0, 1.0], 1.0),
    one=Constant(np.vander([1.0, 2.0, -1.0], 6)),
    metric=Constant(np.eye(3)),
    low=Constant(-np.ones(6)),
    high=Constant(np.ones(6)),
)
allocation.add(bounded=bounded)
wave >> bounded.demand
one >> bounded.effectiveness
metric >> bounded.spread
low >> bounded.lower
high >> bounded.upper
simulate(allocation, 2.0, step=0.1, backend="compiled", progress=False)
"""


@pytest.mark.parametrize(
    "code, printed",
    [
        (LOOP_SCRIPT, "clean"),
        campaign.only(LOOP_SCRIPT + OTHER_SCRIPT, "diverged diverged diverged clean"),
    ],
    ids=["short", "long"],
)
@pytest.mark.skipif(sys.platform != "linux", reason="loads the sanitizer before Python")
def test_simulations(code, printed, tmp_path):
    libraries = []
    for name in ("libasan.so", "libubsan.so"):
        found = subprocess.check_output(["cc", f"-print-file-name={name}"], text=True)
        libraries.append(found.strip())
    if not all(map(os.path.isabs, libraries)):
        pytest.skip("the compiler has no sanitizers")
    environment = os.environ | {
        "LD_PRELOAD": " ".join(libraries),
        "ASAN_OPTIONS": "detect_leaks=0",  # Python's own
        "TRUSSFLOW_CACHE": str(tmp_path),
    }
    command = [sys.executable, "-c", f"{code}print('clean')"]
    run = subprocess.run(
        command, env=environment, capture_output=True, text=True, check=False
    )
    assert run.stdout.split() == printed.split(), run.stderr[-4000:]
