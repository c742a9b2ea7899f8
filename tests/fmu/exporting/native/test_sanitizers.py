"""Our C under the address and undefined-behaviour sanitizers, in random sequences of calls."""

import os
import subprocess
import zipfile
from pathlib import Path

import campaign
import fmpy
import pytest
from fmpy import read_model_description
from systems import Ring

from trussflow.blocks import (
    Diagram,
    Gain,
    Integrator,
    Noise,
    Table,
    UnitDelay,
    ZeroOrderHold,
)
from trussflow.fmu import export

FLAGS = (
    "-g",
    "-O1",
    "-fsanitize=address,undefined,float-cast-overflow",
    "-fno-sanitize-recover=all",
)
FUZZ = Path(__file__).with_name("fuzz.c")
HEADERS = Path(fmpy.__file__).parent / "c-code"


def everything():
    """Return a diagram with a kernel, a table, noise, and two clocks with an offset."""
    diagram = Diagram("everything")
    ring, table, noise = diagram.add(
        ring=Ring(),
        table=Table([0.0, 1.0, 2.0], [0.0, 2.0, 1.0]),
        noise=Noise(0.1, sample_time=0.02, seed=1),
    )
    hold, delay, gain = diagram.add(
        hold=ZeroOrderHold(0.01),
        delay=UnitDelay(0.02).sampled(every=0.02, offset=0.01),
        gain=Gain(0.5),
    )
    integral = diagram.add(integral=Integrator(0.0))
    ring >> table >> hold >> delay >> gain >> integral
    integral >> ring
    diagram.expose(slow=delay.y, sum=ring.total, wander=noise.y, y=integral.y)
    return diagram


@pytest.mark.skipif(os.name != "posix", reason="needs the sanitizers of GCC or Clang")
@pytest.mark.parametrize(
    "name, version, sequences",
    [
        ("everything", "2.0", 100),
        ("hybrid", "3.0", 100),
        *(
            campaign.only(name, version, 5000 * campaign.SIZE)
            for name in ("everything", "hybrid")
            for version in ("2.0", "3.0")
        ),
    ],
)
def test_random_calls(name, version, sequences, systems, tmp_path):
    item = everything() if name == "everything" else systems.hybrid()
    settings = {"version": version, "step": 0.01, "platforms": ()}
    solver = "auto" if name == "everything" else "rk4"
    path = export(item, tmp_path / "one.fmu", solver=solver, **settings)
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
    token = read_model_description(str(path)).guid
    program = tmp_path / "fuzz"
    define = ["-DFMI3"] if version == "3.0" else []
    sources = [str(tmp_path / "sources" / "all.c"), str(FUZZ)]
    built = [
        "cc",
        *FLAGS,
        *define,
        "-I",
        str(HEADERS),
        *sources,
        "-o",
        str(program),
        "-lm",
    ]
    made = subprocess.run(built, capture_output=True, text=True, check=False)
    if "cannot find" in made.stderr and "san" in made.stderr:
        pytest.skip("the compiler has no sanitizers")
    assert made.returncode == 0, made.stderr
    command = [program, token, str(sequences), str(1 + campaign.SEED)]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr[-4000:]
    assert int(run.stdout) > 20 * sequences
