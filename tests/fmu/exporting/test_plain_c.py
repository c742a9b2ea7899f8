"""Plain C: the same numbers as in the process, bit by bit, and no warning from any compiler."""

import ctypes
import subprocess
import sys

import campaign
import numpy as np
import pytest
from numpy.testing import assert_allclose
from systems import ports

from trussflow.blocks import (
    Block,
    Diagram,
    Gain,
    Input,
    Integrator,
    Output,
    Parameter,
    PythonFunction,
    Session,
    Sine,
    State,
    TransferFunction,
    UnitDelay,
)
from trussflow.blocks.tracing.compiler import FLAGS, find_compiler
from trussflow.fmu import export
from trussflow.fmu.errors import ExportError
from trussflow.models import SpaceTruss

STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror")
ZIG = (sys.executable, "-m", "ziglang", "cc")
TIME_STEP = 1e-3


class Compiled:
    """The functions of a source, for one instance."""

    def __init__(self, source, *flags):
        library, compiler = source.with_suffix(".so"), find_compiler()
        command = [
            *compiler,
            *STRICT,
            *flags,
            "-shared",
            "-fPIC",
            str(source),
            "-o",
            str(library),
            "-lm",
        ]
        subprocess.run(command, check=True)
        self._library, self._name = ctypes.CDLL(str(library)), source.stem
        self._memory = ctypes.create_string_buffer(1 << 20)
        self("init")

    def __call__(self, function, *arguments, returns=ctypes.c_int):
        called = getattr(self._library, f"{self._name}_{function}")
        called.restype = returns
        return called(self._memory, *arguments)

    def set(self, name, value):
        if np.ndim(value) == 0:
            return self(f"set_{name}", ctypes.c_double(value))
        return self(
            f"set_{name}",
            np.ascontiguousarray(value, dtype=float).ctypes.data_as(ctypes.c_void_p),
        )

    def get(self, name, shape):
        if not shape:
            return np.array(self(f"get_{name}", returns=ctypes.c_double))
        found = np.zeros(shape)
        self(f"get_{name}", found.ctypes.data_as(ctypes.c_void_p))
        return found


def check_equal(item, inputs, tmp_path, steps=200):
    """Check the outputs against a session, bit by bit, with inputs that change in every step."""
    source = export(item, tmp_path / "made.c", kind="c", step=TIME_STEP)
    compiled = Compiled(source, *FLAGS)
    rng = np.random.default_rng(1)
    with Session(item, step=TIME_STEP) as session:
        session.start()
        for k in range(steps):
            given = {
                name: rng.standard_normal(np.shape(like))
                for name, like in inputs.items()
            }
            session.set(given)
            for name, value in given.items():
                compiled.set(name, value)
            for name, value in session.outputs.items():
                got = compiled.get(name.replace(".", "_"), np.shape(value))
                assert got.tobytes() == np.asarray(value, dtype=float).tobytes(), (
                    name,
                    k,
                )
            assert compiled("step") == 0
            session.advance((k + 1) * TIME_STEP)
            assert compiled("time", returns=ctypes.c_double) == session.time


def filters():
    diagram = Diagram("filters")
    sine, low, gain = diagram.add(
        sine=Sine(1.0, 3.0),
        low=TransferFunction([1.0], [0.01, 1.0]),
        gain=Gain([2.0, 3.0]),
    )
    sine >> low
    diagram.expose(u=gain.u, y=gain.y, smooth=low.y)
    return diagram


@pytest.mark.parametrize(
    "name, inputs",
    [
        ("hybrid", {"target": np.zeros(1)}),
        ("Rotor", {"torque": 0.0}),
        ("filters", {"u": np.zeros(2)}),
    ],
)
def test_outputs_of_small_systems(name, inputs, systems, tmp_path):
    """A plant under sampled control, a matrix and defaults, and filters."""
    item = filters() if name == "filters" else getattr(systems, name)()
    check_equal(item, inputs, tmp_path)


@pytest.mark.campaign
def test_the_plant_with_its_kernels(tmp_path):
    plant = Diagram("plant")
    truss = plant.add(truss=SpaceTruss.consistent())
    plant.expose(force=truss.actuation, q=truss.coordinates, u=truss.speeds)
    check_equal(plant, {"force": np.zeros(truss.actuation.size)}, tmp_path, steps=20)


@pytest.mark.parametrize("optimized", ["-O3", campaign.only("-O0")])
@pytest.mark.usefixtures("ziglang")
def test_no_warnings_from_clang(optimized, systems, tmp_path):
    for i, item in enumerate((systems.hybrid(), systems.Rotor())):
        source = export(item, tmp_path / f"c{i}.c", kind="c")
        object_file = str(source.with_suffix(".o"))
        subprocess.run(
            [*ZIG, *STRICT, optimized, "-c", str(source), "-o", object_file], check=True
        )


def test_the_header_suits_c_plus_plus_and_two_exports_one_program(systems, tmp_path):
    for name in ("one", "two"):
        export(systems.Rotor(), tmp_path / f"{name}.c", kind="c")
    main = tmp_path / "main.cpp"
    main.write_text(
        '#include "one.h"\n#include "two.h"\n#include <cstdio>\n'
        "int main() { static one a; static two b; one_init(&a); two_init(&b);\n"
        "  one_set_torque(&a, 1.0); one_step(&a); two_step(&b);\n"
        "  double v[4]; one_get_axes(&a, v); double w[4]; two_get_axes(&b, w);\n"
        '  std::printf("%.17g %.17g", v[0], w[0]); }\n'
    )
    warnings, program = ("-Wall", "-Wextra", "-Werror"), tmp_path / "main"
    objects = []
    for compiler, source in (("cc", "one.c"), ("cc", "two.c"), ("c++", "main.cpp")):
        objects.append(str(tmp_path / source) + ".o")
        subprocess.run(
            [compiler, *warnings, "-c", str(tmp_path / source), "-o", objects[-1]],
            check=True,
        )
    subprocess.run(["c++", *objects, "-o", str(program), "-lm"], check=True)
    out = subprocess.check_output([program], text=True)
    assert_allclose([float(v) for v in out.split()], [1e-3, 2.5e-3], rtol=1e-15)


def test_nothing_is_allocated(systems, tmp_path):
    text = export(systems.hybrid(), tmp_path / "made.c", kind="c").read_text()
    assert "alloc" not in text
    assert "free(" not in text
    assert "printf" not in text


def test_parameters(tmp_path):
    law = Compiled(export(Gain(1.0), tmp_path / "law.c", kind="c"))
    law.set("u", 1.0)
    law.set("gain", 3.0)
    assert law.get("y", ()) == 3.0


class Continuous(Block):
    """An integral that begins where the user wants."""

    u, y = Input(), Output()
    scale = Parameter(2.0)
    total, scaled = State((2,), initial=1.0), State(initial="scale")

    def output(self, t, x, u, p):
        return {"y": x.total[0] + 10.0 * x.total[1] + 100.0 * x.scaled}

    def derivative(self, t, x, u, p):
        return {"total": np.stack([u.u, 0.0 * u.u]), "scaled": 0.0 * u.u}


class Sampled(Block):
    """A sum of samples that begins where the user wants."""

    u, y = Input(), Output()
    scale = Parameter(2.0)
    total, scaled = State((2,), initial=1.0), State(initial="scale")
    output = Continuous.output

    def update(self, t, x, u, p):
        return {"total": x.total + u.u, "scaled": x.scaled}


@pytest.mark.parametrize(
    "block", [Continuous(), Sampled().sampled(TIME_STEP)], ids=["continuous", "sampled"]
)
def test_states_can_be_set_until_time_goes_on(block, tmp_path):
    made = Compiled(export(block, tmp_path / "made.c", kind="c", step=TIME_STEP))
    with Session(block, step=TIME_STEP) as session:
        session.start(initial={f"{block.name}.total": [3.0, 4.0]}, inputs={"u": 5.0})
        assert made.set("total", np.array([3.0, 4.0])) == 0
        made.set("u", 5.0)
        assert made.get("y", ()) == session.outputs["y"] == 243.0
        assert made("step") == 0
        session.advance(TIME_STEP)
        assert made.set("total", np.zeros(2)) == 1
        assert made.get("y", ()) == session.outputs["y"]
    assert "set_scaled" not in (tmp_path / "made.h").read_text()


def test_a_step_that_is_not_finite_changes_nothing(tmp_path):
    made = Compiled(export(Integrator(1.0), tmp_path / "made.c", kind="c"))
    made.set("u", 1.0)
    assert made("step") == 0
    before = made.get("y", ())
    made.set("u", np.inf)
    assert made("step") == 1
    assert made("time", returns=ctypes.c_double) == TIME_STEP
    assert made.get("y", ()) == before
    made.set("u", 0.0)
    assert made("step") == 0
    assert made.set("initial_value", 2.0) == 1
    held = Compiled(export(UnitDelay(TIME_STEP), tmp_path / "held.c", kind="c"))
    held.set("u", np.nan)  # no state of the solver sees it
    assert held("step") == 1
    assert held("time", returns=ctypes.c_double) == 0.0


def equal_names():
    inner, outer = Diagram("inner"), Diagram("outer")
    gain = inner.add(b=Gain(1.0))
    inner.expose(u=gain.u, y=gain.y)
    one, two = outer.add(a_b=Gain(1.0), a=inner)
    outer.expose(u=one.u, v=one.y, w=two.u, y=two.y)
    return outer


@pytest.mark.parametrize(
    "make, name, settings, message",
    [
        (
            lambda: Gain(1.0),
            "made.cpp",
            {},
            "the name must be a C identifier .*, such as controller.c",
        ),
        (lambda: Gain(1.0), "2made.c", {}, "the name must be a C identifier"),
        (
            lambda: Gain(1.0),
            "made.c",
            {"platforms": "all"},
            "leave out version and platforms",
        ),
        (
            lambda: Gain(1.0),
            "made.c",
            {"solver": "Rodas5P"},
            "unknown solver for kind='c': 'Rodas5P'; choose from: rk4",
        ),
        (lambda: Gain(1.0), "no/made.c", {}, "there is no folder"),
        (
            lambda: PythonFunction(abs, 0.1, **ports(u=(), y=())),
            "made.c",
            {},
            "in plain C: .* runs Python code",
        ),
        (equal_names, "made.c", {}, r"would both be made_set_a_b_gain; rename one"),
    ],
)
def test_exports_that_are_refused(make, name, settings, message, tmp_path):
    with pytest.raises(ExportError, match=message):
        export(make(), tmp_path / name, kind="c", **settings)
    assert not list(tmp_path.iterdir())
