"""What goes into a run of units and what comes out: units, logs, provenance, errors."""

import json

import numpy as np
import pytest
import xarray as xr

from trussflow.blocks import (
    Constant,
    CoSimulator,
    Diagram,
    DivergenceError,
    Function,
    Gain,
    Input,
    Integrator,
    NameLookupError,
    OpenInputError,
    Output,
    ParameterError,
    PythonFunction,
    SimulationError,
    SimulationInterrupted,
    StateSpace,
    StopWhen,
    ZeroOrderHold,
    cosimulate,
    simulate,
)
from trussflow.blocks.cosimulation.fixed_point import NotConvergedError, fixed_point
from trussflow.blocks.framework.types import Vector

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
        sample_time=H,
        inputs={"a": Input(), "b": Input(default=0.25)},
        outputs={"c": Output()},
    )
    system, rest, plus = diagram.add(plant=plant(), inner=inner, law=law)
    total = diagram.add(total=Gain(1.0))
    system.y[1] >> rest.u
    diagram.connect(rest.y, total.u)
    diagram.connect(total.y, system.u[1])
    diagram.ground(system.u[0])
    system.y[2] >> plus.a
    return diagram


def test_the_result_is_that_of_a_simulation():
    whole = simulate(nested(), 1.0, step=H)
    result = cosimulate(nested(), 1.0, step=H, members=["plant", "inner"])
    assert set(result.data_vars) == set(whole.data_vars)
    for name, variable in whole.data_vars.items():
        assert result[name].dims == variable.dims
        assert result[name].attrs == variable.attrs
    np.testing.assert_array_equal(result["time"], whole["time"])
    assert result.attrs["status"] == "complete"
    assert json.loads(result.attrs["members"]) == ["plant", "inner", "the rest"]
    assert result.attrs["coupling"] == "jacobi"
    assert result.attrs["communication_step"] == H
    assert result.attrs["communication_steps"] == 16
    assert json.loads(result.attrs["parameters"])["plant.initial_value"] == [1.0, 0.0]


@pytest.mark.parametrize("python", [False, True])
@pytest.mark.parametrize("coupling", ["jacobi", "gauss-seidel", "iterate"])
def test_units_that_exchange_sampled_signals_only_equal_the_whole(coupling, python):
    """Held signals are exact in every scheme, so where to cut makes no difference."""

    def diagram():
        found = Diagram("sampled")
        same = PythonFunction(lambda u: u, H, inputs={"u": Input()}, outputs={"y": Output()})
        hold, a, b = found.add(hold=ZeroOrderHold(2 * H), a=plant(), b=same if python else ZeroOrderHold(H))
        found.connect(a.y[0], b.u)
        found.connect(b.y, hold.u)
        found.connect(hold.y, a.u[1])
        found.ground(a.u[0])
        return found

    whole = simulate(diagram(), 2.0, step=H / 4, log_step=H)
    for units in (["a"], ["a", "b"], ["b"], ["hold", "b"], ["hold"]):
        for extrapolation in (0, 1):
            result = cosimulate(
                diagram(),
                2.0,
                step=H,
                solver_step=H / 4,
                members=units,
                coupling=coupling,
                extrapolation=extrapolation,
            )
            for name in ("hold.y", "b.y", "a.y"):
                np.testing.assert_allclose(
                    result[name], whole[name], rtol=1e-12, atol=1e-15, err_msg=str(units)
                )


def test_one_unit_alone_is_a_simulation():
    whole = simulate(nested(), 1.0, step=H)
    result = cosimulate(nested(), 1.0, step=H)
    for name in ("plant.y", "inner.hold.y", "law.c"):
        np.testing.assert_allclose(result[name], whole[name], rtol=1e-13)


def test_what_is_logged_can_be_chosen(tmp_path):
    diagram = nested()
    master = CoSimulator(
        diagram,
        step=H,
        members=["plant"],
        log_step=4 * H,
        log={"speed": diagram.blocks["plant"].port("y")[1], "in": "inner.gain.u"},
    )
    result = master.run(1.0, stream_to=tmp_path / "result.nc")
    np.testing.assert_array_equal(result["time"], np.arange(0.0, 1.01, 4 * H))
    np.testing.assert_array_equal(result["speed"], result["in"])
    whole = cosimulate(nested(), 1.0, step=H, members=["plant"])
    np.testing.assert_array_equal(result["speed"], whole["plant.y"][::4, 1])
    with xr.open_dataset(tmp_path / "result.nc") as stored:
        assert stored.attrs["status"] == "complete"


def test_parameters_and_initial_states_go_to_their_units():
    diagram = Diagram("two")
    a, b = diagram.add(a=Integrator(1.0), b=Gain(2.0))
    a >> b >> a
    result = cosimulate(
        diagram, 1.0, step=1.0, members=["a"], parameters={"b.gain": -3.0}, initial={"a.integral": 5.0}
    )
    np.testing.assert_allclose(result["a.y"], [5.0, -10.0], rtol=1e-15)
    assert json.loads(result.attrs["parameters"])["b.gain"] == [-3.0]
    assert json.loads(result.attrs["initial_states"]) == {"a.integral": 5.0}


def test_inputs_of_blocks_that_step_themselves(stepping):
    """Slices, grounds and constants reach them, and their inputs can be logged."""
    diagram = Diagram("outside")
    own, source = diagram.add(own=stepping(plant(), H), source=Constant([3.0, 4.0]))
    diagram.connect(source.y[1], own.u[1])
    diagram.ground(own.u[0])
    result = cosimulate(diagram, 1.0, step=H, log=["own.u", "own.y"])
    np.testing.assert_array_equal(result["own.u"], np.tile([0.0, 4.0], (17, 1)))
    twin = Diagram("inside")
    inner, value = twin.add(own=plant(), source=Constant([3.0, 4.0]))
    twin.connect(value.y[1], inner.u[1])
    twin.ground(inner.u[0])
    np.testing.assert_allclose(result["own.y"], simulate(twin, 1.0, step=H)["own.y"], rtol=1e-12, atol=1e-15)


def test_initial_states_that_depend_on_other_units_are_settled():
    """As in a whole run: the second starts where the output of the first is."""

    class Follower(Integrator):
        def initial_state(self, u, p):
            return {"integral": 2.0 * u.u}

    def diagram():
        found = Diagram("following")
        third, second, first = found.add(third=Follower(), second=Follower(), first=Integrator(3.0))
        first >> second >> third
        third >> first
        return found

    whole = simulate(diagram(), H, step=H)
    for units in (["first"], ["third", "first"], ["second"]):
        result = cosimulate(diagram(), H, step=H, members=units)
        for name in ("first.y", "second.y", "third.y"):
            assert result[name][0] == whole[name][0], units
    assert whole["third.y"][0] == 12.0


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"coupling": "seidel"}, SimulationError, "unknown coupling 'seidel'; choose from: jacobi"),
        ({"extrapolation": 2}, SimulationError, "extrapolation = 2 must be 0 or 1"),
        ({"step": -1.0}, SimulationError, r"step = -1\.0 must be a positive"),
        ({"tolerance": 0.0}, SimulationError, r"tolerance = 0\.0 must be a positive"),
        ({"tolerance": 0.1, "log_step": 1.0}, SimulationError, "log_step and tolerance do not go"),
        ({"log_step": 1.5 * H}, SimulationError, "log_step of .* not a whole number"),
        ({"solver_step": H / 1.5}, SimulationError, "communication step of .* not a whole number"),
        ({"members": ["nothing"]}, NameLookupError, "no block 'nothing' for a member; there are: plant"),
        ({"members": ["inner", "inner.gain"]}, SimulationError, r"'inner\.gain' cannot be in two mem"),
        ({"members": ["plant"], "order": ["plant"]}, SimulationError, "must name each member once"),
        ({"order": ["plant"]}, NameLookupError, "no member 'plant' for the order; .* the rest"),
        ({"parameters": {"no.p": 1.0}}, NameLookupError, r"no parameter 'no\.p': .* no block 'no'"),
        ({"parameters": {"plant.p": 1.0}}, NameLookupError, r"no parameter 'plant\.p'"),
        ({"initial": {"no.x": 1.0}}, NameLookupError, r"no state 'no\.x': there is no block 'no'"),
        ({"log": ["plant.z"]}, NameLookupError, "no port 'z'"),
        ({"largest_step": -1.0, "tolerance": 0.1}, SimulationError, "largest_step = -1.0"),
        ({"largest_step": 1.0}, SimulationError, r"largest_step = 1\.0 has no meaning without"),
        ({"absolute_tolerance": 1e-3}, SimulationError, r"0\.001 has no meaning without"),
        ({"most_iterations": 2.5}, SimulationError, r"most_iterations = 2\.5 must be a positive"),
        ({"members": "plant"}, SimulationError, r"members = 'plant' must be a list: members=\['plant'"),
        ({"order": "plant"}, SimulationError, r"order = 'plant' must be a list"),
        ({"log": "plant.y"}, SimulationError, r"the ports to log, 'plant\.y', must be a list"),
    ],
)
def test_arguments_that_make_no_sense(settings, error, message):
    with pytest.raises(error, match=message):
        cosimulate(nested(), 1.0, **{"step": H, **settings})


def test_values_of_blocks_that_step_themselves(stepping):
    def diagram():
        found = Diagram("one")
        own = found.add(own=stepping(plant(), H))
        found.ground(own.u)
        return found

    with pytest.raises(NameLookupError, match=r"state 'own\.x' here: 'own' steps itself; give it"):
        cosimulate(diagram(), 1.0, step=H, initial={"own.x": 1.0})
    with pytest.raises(NameLookupError, match=r"no parameter 'own\.p'; 'own' has: none"):
        cosimulate(diagram(), 1.0, step=H, parameters={"own.p": 1.0})
    open_ = Diagram("open")
    open_.add(own=stepping(plant(), H))
    with pytest.raises(OpenInputError, match=r"'own\.u'"):
        cosimulate(open_, 1.0, step=H)


def test_a_duration_is_a_whole_number_of_steps():
    """But for round-off, as in a whole run."""
    with pytest.raises(SimulationError, match=r"the duration of 1\.03 s is not a whole number"):
        cosimulate(nested(), 1.03, step=H)
    added_up = float(np.cumsum([H / 3] * 3000)[-1])  # off by more than the last places
    assert added_up != 1000 * H
    assert cosimulate(nested(), added_up, step=H, log=["plant.y"])["time"].size == 1001


def growing():
    diagram = Diagram("growing")
    a, b = diagram.add(
        a=Integrator(1.0),
        b=Function(
            lambda u: np.where(u < 5.0, 8.0 * u, np.nan), inputs={"u": Input()}, outputs={"y": Output()}
        ),
    )
    a >> b >> a
    return diagram


def test_divergence_names_the_signal_and_keeps_the_log():
    with pytest.raises(DivergenceError, match=r"'b\.y' stopped being finite at t = 0\.25 s") as no:
        cosimulate(growing(), 1.0, step=H, members=["a"])
    result = no.value.result
    assert isinstance(result, xr.Dataset)
    assert result.attrs["status"] == "diverged"
    np.testing.assert_allclose(result["a.y"], 1.5 ** np.arange(4), rtol=ROUND_OFF)
    diagram = Diagram("fast")
    fast, gain = diagram.add(
        fast=StateSpace([[1e9]], [[1.0]], [[1.0]], [[0.0]], initial_value=[1.0]), gain=Gain(1.0)
    )
    fast >> gain >> fast
    with pytest.raises(DivergenceError, match=r"'fast\.x' \(element 0\) stopped being finite"):
        cosimulate(diagram, 1.0, step=H, members=["fast"])


def test_ctrl_c_keeps_the_log(stepping):
    diagram = Diagram("long")
    own, source = diagram.add(own=stepping(plant(), H), source=Constant([1.0, 1.0]))
    source >> own.u
    master = CoSimulator(diagram, step=H)
    kind = type(own.open({}))
    advance = kind.advance

    def interrupted(self, now, until):
        if now >= 0.5:
            raise KeyboardInterrupt
        advance(self, now, until)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kind, "advance", interrupted)
        with pytest.raises(SimulationInterrupted, match=r"stopped at t = 0\.5 s") as stopped:
            master.run(1.0)
    assert len(stopped.value.result["time"]) == 9  # type: ignore[index]
    assert own.runs[-1].calls[-1] == "close"
    assert len(master.run(1.0)["time"]) == 17


def test_fixed_points_of_affine_maps_need_one_round_for_each_direction():
    rng = np.random.default_rng(1)
    matrix = rng.normal(size=(6, 6)) * 2.0  # expanding: plain iteration diverges
    constant = rng.normal(size=6)

    def function(u):
        found: Vector = matrix @ u + constant
        return found

    u, rounds = fixed_point(function, np.zeros(6), 1e-10, 20)
    np.testing.assert_allclose(u, np.linalg.solve(np.eye(6) - matrix, constant), rtol=1e-8)
    assert rounds <= 9
    with pytest.raises(NotConvergedError):
        fixed_point(lambda u: u + 1.0, np.zeros(2), 1e-10, 20)
    with pytest.raises(NotConvergedError):
        fixed_point(lambda u: u * np.nan, np.ones(2), 1e-10, 20)
    assert fixed_point(lambda u: u, np.zeros(0), 1e-10, 20)[1] == 1


def test_a_parameter_that_is_not_allowed_is_refused_as_everywhere():
    with pytest.raises(ParameterError, match="of block 'total' is not finite: nan"):
        cosimulate(nested(), 1.0, step=H, parameters={"total.gain": np.nan})


@pytest.mark.parametrize("settings", [{"step": H}, {"step": H / 4, "tolerance": 1e-6}])
def test_a_run_ends_where_a_comparison_becomes_true(settings):
    """The integral of 1 passes 0.3 within a communication step: the rows before are a result, as in a run."""
    diagram = Diagram("until")
    one, clock, stop = diagram.add(one=Constant(1.0), clock=Integrator(), stop=StopWhen("enough"))
    one >> clock
    (clock.y > 0.3) >> stop
    result = cosimulate(diagram, 1.0, **settings)
    assert result.attrs["status"] == "ended"
    assert result.attrs["ended"] == "'stop' ended the run at t = 0.3 s enough"
    assert 0.3 - settings["step"] * 2 < result["time"][-1] <= 0.3
    np.testing.assert_allclose(result["clock.y"], result["time"], rtol=0, atol=ROUND_OFF)
