"""Inputs and results of co-simulations: partitions, logs, provenance, errors."""

import json

import numpy as np
import pytest
import xarray as xr
from numpy.testing import assert_allclose, assert_array_equal
from systems import Follower, assert_near, ports, ring

from trussflow.blocks import (
    Constant,
    CoSimulator,
    Diagram,
    Function,
    Gain,
    Input,
    Integrator,
    Output,
    PythonFunction,
    StateSpace,
    StopWhen,
    ZeroOrderHold,
    cosimulate,
    simulate,
)
from trussflow.blocks.errors import (
    DivergenceError,
    NameLookupError,
    ParameterError,
    SimulationError,
    SimulationInterrupted,
)

ROUND_OFF = 1e-14  # relative: a few operations of 1e-16 each
H = 0.0625  # s


def plant():
    return StateSpace(
        [[0.0, 1.0], [-4.0, -0.4]],
        [[0.0, 0.0], [1.0, 2.0]],
        [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]],
        np.zeros((3, 2)),
        initial_value=[1.0, 0.0],
    )


def nested():
    """Slices, a ground, a default, a diagram within, sampled and Python blocks."""
    diagram = Diagram("nested")
    inner = Diagram("inner")
    gain, hold = inner.add(gain=Gain(-2.0), hold=ZeroOrderHold(2 * H))
    gain >> hold
    inner.expose(u=gain.u, y=hold.y)
    law = PythonFunction(
        lambda a, b: 0.5 * a - b,
        H,
        inputs={"a": Input(), "b": Input(default=0.25)},
        outputs={"c": Output()},
    )
    system, inner, law, total = diagram.add(
        plant=plant(), inner=inner, law=law, total=Gain(1.0)
    )
    system.y[1] >> inner.u
    inner.y >> total
    total.y >> system.u[1]
    diagram.ground(system.u[0])
    system.y[2] >> law.a
    return diagram


@pytest.fixture(scope="module")
def whole():
    return simulate(nested(), 1.0, step=H)


def test_the_result_is_that_of_a_simulation(whole):
    result = cosimulate(nested(), 1.0, step=H, members=["plant", "inner"])
    assert set(result.data_vars) == set(whole.data_vars)
    for name, variable in whole.data_vars.items():
        assert result[name].dims == variable.dims
        assert result[name].attrs == variable.attrs
    assert_array_equal(result["time"], whole["time"])
    assert result.attrs["status"] == "complete"
    assert json.loads(result.attrs["members"]) == ["plant", "inner", "the rest"]
    assert result.attrs["coupling"] == "jacobi"
    assert result.attrs["communication_step"] == H
    assert result.attrs["communication_steps"] == 16
    assert json.loads(result.attrs["parameters"])["plant.initial_value"] == [1.0, 0.0]


def test_one_member_alone_is_a_simulation(whole):
    result = cosimulate(nested(), 1.0, step=H)
    for name in ("plant.y", "inner.hold.y", "law.c"):
        assert_allclose(result[name], whole[name], rtol=1e-13)


@pytest.mark.parametrize("python", [False, True])
@pytest.mark.parametrize("coupling", ["jacobi", "gauss-seidel", "iterate"])
def test_members_that_exchange_only_sampled_signals_equal_the_whole(coupling, python):
    """Held signals are exact in every scheme, for every partition into members."""

    def diagram():
        same = PythonFunction(lambda u: u, H, **ports(u=(), y=()))
        sampled = Diagram("sampled")
        hold, a, b = sampled.add(
            hold=ZeroOrderHold(2 * H), a=plant(), b=same if python else ZeroOrderHold(H)
        )
        a.y[0] >> b.u
        b.y >> hold.u
        hold.y >> a.u[1]
        sampled.ground(a.u[0])
        return sampled

    whole = simulate(diagram(), 8 * H, step=H / 4, log_step=H)
    schemes = {"step": H, "solver_step": H / 4, "coupling": coupling}
    for members in (["a"], ["a", "b"], ["b"], ["hold", "b"], ["hold"]):
        result = cosimulate(diagram(), 8 * H, members=members, **schemes)
        for name in ("hold.y", "b.y", "a.y"):
            assert_allclose(
                result[name], whole[name], rtol=1e-12, atol=1e-15, err_msg=str(members)
            )


def test_log_can_be_chosen(tmp_path):
    diagram = nested()
    log = {"speed": diagram.plant.y[1], "in": "inner.gain.u"}
    master = CoSimulator(diagram, step=H, members=["plant"], log_step=4 * H, log=log)
    result = master.run(1.0, stream_to=tmp_path / "result.nc")
    assert_array_equal(result["time"], np.arange(0.0, 1.01, 4 * H))
    assert_array_equal(result["speed"], result["in"])
    every_step = cosimulate(nested(), 1.0, step=H, members=["plant"])
    assert_array_equal(result["speed"], every_step["plant.y"][::4, 1])
    with xr.open_dataset(tmp_path / "result.nc") as stored:
        assert stored.attrs["status"] == "complete"


def test_parameters_and_initial_states_go_to_their_units():
    diagram = ring("two", a=Integrator(1.0), b=Gain(2.0))
    result = cosimulate(
        diagram,
        1.0,
        step=1.0,
        members=["a"],
        parameters={"b.gain": -3.0},
        initial={"a.integral": 5.0},
    )
    assert_allclose(result["a.y"], [5.0, -10.0], rtol=1e-15)
    assert json.loads(result.attrs["parameters"])["b.gain"] == [-3.0]
    assert json.loads(result.attrs["initial_states"]) == {"a.integral": 5.0}


def driven(block):
    """Return a diagram with a block of two inputs: one is grounded, one an element of a constant."""
    diagram = Diagram("driven")
    own, source = diagram.add(own=block, source=Constant([3.0, 4.0]))
    source.y[1] >> own.u[1]
    diagram.ground(own.u[0])
    return diagram


def test_inputs_of_blocks_that_step_themselves(stepping):
    """Slices, grounds and constants reach them, and their inputs can be logged."""
    result = cosimulate(
        driven(stepping(plant(), H)), 1.0, step=H, log=["own.u", "own.y"]
    )
    assert_array_equal(result["own.u"], np.tile([0.0, 4.0], (17, 1)))
    whole = simulate(driven(plant()), 1.0, step=H)
    assert_allclose(result["own.y"], whole["own.y"], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("members", [["first"], ["third", "first"], ["second"]])
def test_initial_states_that_depend_on_other_members_are_solved(members):
    diagram = Diagram("following")
    third, second, first = diagram.add(
        third=Follower(), second=Follower(), first=Integrator(3.0)
    )
    first >> second >> third >> first
    result = cosimulate(diagram, H, step=H, members=members)
    assert [result[f"{name}.y"][0] for name in ("first", "second", "third")] == [
        3.0,
        4.0,
        5.0,
    ]


@pytest.mark.parametrize(
    "settings, error, message",
    [
        (
            {"coupling": "seidel"},
            SimulationError,
            "unknown coupling 'seidel'; choose from: jacobi",
        ),
        ({"step": -1.0}, SimulationError, r"step = -1\.0 must be a positive"),
        ({"tolerance": 0.0}, SimulationError, r"tolerance = 0\.0 must be a positive"),
        (
            {"tolerance": 0.1, "log_step": 1.0},
            SimulationError,
            "log_step and tolerance exclude",
        ),
        ({"log_step": 1.5 * H}, SimulationError, "log_step of .* not a whole number"),
        (
            {"solver_step": H / 1.5},
            SimulationError,
            "communication step of .* not a whole number",
        ),
        (
            {"members": ["nothing"]},
            NameLookupError,
            "no block 'nothing' for a member; there are: plant",
        ),
        (
            {"members": ["inner", "inner.gain"]},
            SimulationError,
            r"'inner\.gain' cannot be in two mem",
        ),
        (
            {"parameters": {"no.p": 1.0}},
            NameLookupError,
            r"no parameter 'no\.p': .* no block 'no'",
        ),
        (
            {"parameters": {"total.gain": np.nan}},
            ParameterError,
            "of block 'total' is not finite: nan",
        ),
        (
            {"initial": {"no.x": 1.0}},
            NameLookupError,
            r"no state 'no\.x': there is no block 'no'",
        ),
        ({"log": ["plant.z"]}, NameLookupError, "no port 'z'"),
        (
            {"largest_step": -1.0, "tolerance": 0.1},
            SimulationError,
            "largest_step = -1.0",
        ),
        (
            {"largest_step": 1.0},
            SimulationError,
            r"largest_step = 1\.0 has no meaning without",
        ),
        (
            {"members": "plant"},
            SimulationError,
            r"members = 'plant' must be a list: members=\['plant'",
        ),
        (
            {"log": "plant.y"},
            SimulationError,
            r"the ports to log must be a list, .* not 'plant\.y'",
        ),
    ],
)
def test_arguments_that_make_no_sense(settings, error, message):
    with pytest.raises(error, match=message):
        cosimulate(nested(), 1.0, **{"step": H, **settings})


@pytest.mark.parametrize(
    "settings, message",
    [
        (
            {"initial": {"own.x": 1.0}},
            r"state 'own\.x' here: 'own' steps itself; give it",
        ),
        ({"parameters": {"own.p": 1.0}}, r"no parameter 'own\.p'; 'own' has: none"),
    ],
)
def test_values_of_blocks_that_step_themselves(settings, message, stepping):
    with pytest.raises(NameLookupError, match=message):
        cosimulate(driven(stepping(plant(), H)), 1.0, step=H, **settings)


def test_a_duration_is_a_whole_number_of_steps():
    """But for round-off, as in a whole run."""
    with pytest.raises(
        SimulationError, match=r"the duration of 1\.03 s is not a whole number"
    ):
        cosimulate(nested(), 1.03, step=H)
    added_up = np.cumsum([H / 3] * 3000)[-1]  # off by more than the last places
    assert added_up != 1000 * H
    assert cosimulate(nested(), added_up, step=H, log=["plant.y"])["time"].size == 1001


def test_divergence_names_the_signal_and_keeps_the_log():
    growth = Function(lambda u: np.where(u < 5.0, 8.0 * u, np.nan))
    diagram = ring(a=Integrator(1.0), b=growth)
    with pytest.raises(
        DivergenceError, match=r"'b\.y' stopped being finite at t = 0\.25 s"
    ) as caught:
        cosimulate(diagram, 1.0, step=H, members=["a"])
    result = caught.value.result
    assert isinstance(result, xr.Dataset)
    assert result.attrs["status"] == "diverged"
    assert_allclose(result["a.y"], 1.5 ** np.arange(4), rtol=ROUND_OFF)


def test_divergence_of_a_state_is_named():
    diagram = ring(
        "fast",
        fast=StateSpace([[1e9]], [1.0], [1.0], 0.0, initial_value=[1.0]),
        gain=Gain(1.0),
    )
    with pytest.raises(
        DivergenceError, match=r"'fast\.x' \(element 0\) stopped being finite"
    ):
        cosimulate(diagram, 1.0, step=H, members=["fast"])


def test_ctrl_c_keeps_the_log(stepping, monkeypatch):
    diagram = driven(stepping(plant(), H))
    master = CoSimulator(diagram, step=H)
    kind = type(diagram.own.open({}))
    advance = kind.advance

    def interrupted(self, now, until):
        if now >= 0.5:
            raise KeyboardInterrupt
        advance(self, now, until)

    monkeypatch.setattr(kind, "advance", interrupted)
    with pytest.raises(SimulationInterrupted, match=r"stopped at t = 0\.5 s") as caught:
        master.run(1.0)
    assert len(caught.value.result["time"]) == 9
    assert diagram.own.runs[-1].calls[-1] == "close"
    monkeypatch.undo()
    assert len(master.run(1.0)["time"]) == 17


@pytest.mark.parametrize("settings", [{"step": H}, {"step": H / 4, "tolerance": 1e-6}])
def test_a_run_ends_where_a_comparison_becomes_true(settings):
    """The integral of 1 passes 0.3 within a communication step: the rows before are a result, as in a run."""
    diagram = Diagram("until")
    one, clock, stop = diagram.add(
        one=Constant(1.0), clock=Integrator(), stop=StopWhen("enough")
    )
    one >> clock
    (clock.y > 0.3) >> stop
    result = cosimulate(diagram, 1.0, **settings)
    assert result.attrs["status"] == "ended"
    assert result.attrs["ended"] == "'stop' ended the run at t = 0.3 s enough"
    assert 0.3 - settings["step"] * 2 < result["time"][-1] <= 0.3
    assert_near(result["clock.y"], result["time"], ROUND_OFF)
