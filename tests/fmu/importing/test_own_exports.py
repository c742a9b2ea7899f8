"""Exported FMUs, imported again: the same numbers as the block in this process."""

import zipfile

import campaign
import numpy as np
import pytest
from fmpy import simulate_fmu
from numpy.testing import assert_allclose, assert_array_equal
from systems import assert_near, series

from trussflow.blocks import (
    Constant,
    Diagram,
    Gain,
    OperatingPoint,
    Pulse,
    Sine,
    StateSpace,
    Sum,
    ZeroOrderHold,
    linearize,
    simulate,
    trim,
)
from trussflow.blocks.errors import OpenInputError
from trussflow.blocks.simulation.solver import FIXED_STEP
from trussflow.fmu import Fmu, export

ROUND_OFF = 1e-12
versions = pytest.mark.parametrize("version", ["2.0", "3.0"])


def driven(plant, duration, step, **options):
    """Return the outputs of three oscillators, driven by sines."""
    diagram = Diagram("driven")
    diagram.add(plant=plant, drive=Sine([1.0, 2.0, 3.0], frequency=2.0, unit="N"))
    diagram.drive >> diagram.plant.force
    result = simulate(diagram, duration, step=step, **options)
    return np.column_stack(
        [result[f"plant.{name}"] for name in ("position", "angle", "total")]
    )


@versions
@pytest.mark.parametrize("solver", FIXED_STEP)
def test_model_exchange_equals_the_block(exported, systems, version, solver):
    """Runs by one solver are equal to round-off, with changed parameters too."""
    settings = {"solver": solver, "parameters": {"plant.stiffness": [7.0, 8.0, 9.0]}}
    path = exported(systems.Oscillator(3), version, "three")
    ours, theirs = (
        driven(plant, 1.0, 1e-2, **settings)
        for plant in (systems.Oscillator(3), Fmu(path, kind="me"))
    )
    assert_near(theirs, ours, ROUND_OFF)


@versions
def test_ports_come_back_as_they_were(exported, systems, version):
    ours = systems.Oscillator(3)
    theirs = Fmu(exported(ours, version, "three"), kind="cs", step=1e-3)
    for name, port in ours.ports.items():
        assert theirs.ports[name].whole_shape == port.whole_shape
        assert theirs.ports[name].unit == port.unit
    assert theirs.feedthrough() == {"position": (), "angle": (), "total": ()}
    for name, value in ours.parameters.items():
        assert_array_equal(theirs.parameters[name], value)
    direct = Fmu(exported(systems.Rotor(), version), kind="cs", step=1e-3)
    assert direct.feedthrough() == {"axes": ("torque",)}


RNG = np.random.default_rng(campaign.SEED)


@versions
@pytest.mark.parametrize(
    "period, high, late, sample",
    [
        (10, 4, 0, 0.04),
        *(
            campaign.only(
                *RNG.integers((5, 1, 0), (30, 5, 9)), RNG.integers(1, 90) / 1e3
            )
            for _ in range(20 * campaign.SIZE)
        ),
    ],
)
def test_events_on_sample_instants(version, period, high, late, sample, tmp_path):
    """Edges of pulses, counted in samples, are held at once: 0.56 s is early by round-off, 0.16 s late."""
    diagram = series(
        "edges",
        pulse=Pulse(period * sample, high / period, delay=late * sample),
        hold=ZeroOrderHold(sample),
    )
    diagram.expose(y=diagram.hold.y)
    end = 2 * (period + late) * sample
    count = np.rint(np.arange(0.0, end + sample / 2, sample) / sample) - late
    expected = (count >= 0) & (count % period < high)
    for backend in ("numpy", "compiled"):
        found = simulate(
            diagram, end, step=sample, log={"y": diagram.hold.y}, backend=backend
        )["y"]
        assert_array_equal(found, expected, err_msg=backend)
    path = export(diagram, tmp_path / "edges.fmu", version=version, step=sample)
    for kind, name in (("cs", "CoSimulation"), ("me", "ModelExchange")):
        importer = series(f=Fmu(path, kind=kind))
        ours = simulate(importer, end, step=sample)["f.y"]
        assert_array_equal(ours, expected, err_msg=kind)
        for early in {version == "3.0" and kind == "cs", False}:
            rows = simulate_fmu(
                str(path),
                stop_time=end,
                output_interval=sample,
                fmi_type=name,
                early_return_allowed=early,
            )
            after = (
                np.searchsorted(
                    rows["time"], np.arange(expected.size) * sample + sample / 9
                )
                - 1
            )
            assert_array_equal(
                rows["y"][after], expected, err_msg=f"FMPy {kind} {early}"
            )


SYSTEMS = {
    "three": lambda systems: systems.Oscillator(3),
    "rotor": lambda systems: systems.Rotor(),
    "direct": lambda _: StateSpace(
        -np.eye(2), np.ones((2, 2)), [[1.0, 2.0]], [[0.5, -0.25]]
    ),
}


def alone(block):
    diagram = series(f=block)
    diagram.expose(**{port.name: port for port in (*block.inputs(), *block.outputs())})
    return diagram


@versions
@pytest.mark.parametrize("own", [True, False])
@pytest.mark.parametrize("name", SYSTEMS)
def test_linear_models_are_those_of_the_block(
    name, own, version, exported, systems, tmp_path
):
    """By derivatives of the FMU's own, or by differences if it has none; and trimmed."""
    ours, path = (
        alone(SYSTEMS[name](systems)),
        exported(SYSTEMS[name](systems), version, name),
    )
    if not own:
        with (
            zipfile.ZipFile(path) as old,
            zipfile.ZipFile(tmp_path / "none.fmu", "w") as new,
        ):
            for file in old.namelist():
                new.writestr(
                    file, old.read(file).replace(b"providesDirectional", b"needsNo")
                )
        path = tmp_path / "none.fmu"
    theirs = alone(Fmu(path, kind="me"))
    start, rng = linearize(ours).operating_point, np.random.default_rng(1)
    states, inputs = (
        {key: rng.normal(size=value.shape) for key, value in values.items()}
        for values in (start.states, start.inputs)
    )
    point = OperatingPoint(time=0.3, states=states, inputs=inputs)
    expected, found = linearize(ours, at=point), linearize(theirs, at=point)
    for matrix in "ABCD":
        assert_near(
            getattr(found, matrix),
            getattr(expected, matrix),
            ROUND_OFF if own else 1e-7,
        )
    assert found.derivatives["f"].startswith("its own" if own else "differences")
    if name != "rotor":
        rests = (trim(d, at=point).states for d in (ours, theirs))
        assert_allclose(
            *(np.concatenate([*map(np.ravel, r.values())]) for r in rests),
            rtol=0,
            atol=1e-7,
        )


@versions
def test_solved_loops(version, exported, systems):
    """Feedthrough, fed back: u = r - 0.7 y, as in a loop of blocks."""
    path = exported(SYSTEMS["direct"](systems), version, "direct")
    models, runs = [], []
    for block in (SYSTEMS["direct"](systems), Fmu(path, kind="me")):
        loop = Diagram("loop", loops="solve")
        loop.add(f=block, law=Gain(0.7), error=Sum("+-"), drive=Sine([1.0]))
        loop.f.y >> loop.law >> loop.error.u2
        loop.drive >> loop.error.u1
        loop.error.y >> loop.f.u[0:1]
        loop.ground(loop.f.u[1:2])
        models.append(linearize(loop, loop.error.u1, loop.f.y))
        runs.append(simulate(loop, 1.0, step=0.01)["f.y"])
    for matrix in "ABCD":
        assert_near(*(getattr(m, matrix) for m in models), ROUND_OFF)
    assert_near(*runs, ROUND_OFF)


def test_open_inputs_may_keep_declared_start_values(exported, systems):
    """A vector has one value for all its elements; without the option every input must be wired."""
    ours = Diagram("ours")
    ours.add(f=systems.Oscillator(2), drive=Constant([0.5, 0.5], unit="N"))
    ours.drive >> ours.f.force
    runs = [simulate(ours, 1.0, step=0.01)["f.position"]]
    for name, force, option in (
        ("same", 0.5, True),
        ("same", 0.5, False),
        ("mixed", 1.0, True),
    ):
        path = exported(
            systems.Oscillator(2), "2.0", name, start={"force": [0.5, force]}
        )
        theirs = series(f=Fmu(path, kind="me", declared_starts=option))
        if not option or force != 0.5:
            with pytest.raises(OpenInputError, match="force"):
                simulate(theirs, 1.0, step=0.01)
        else:
            runs.append(simulate(theirs, 1.0, step=0.01)["f.position"])
    assert_near(*runs, ROUND_OFF)
