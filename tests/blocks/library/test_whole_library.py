"""Every block, in one of two diagrams: interpreted and compiled, it does what NumPy does."""

import subprocess
import sys

import campaign
import numpy as np
import pytest
from systems import assert_near, ports, series

import trussflow.blocks as library
from trussflow.blocks import (
    PD,
    PID,
    Backlash,
    Block,
    BoundedAllocation,
    Constant,
    ConventionalSlidingMode,
    DeadZone,
    Diagram,
    DiscretePID,
    DiscreteStateSpace,
    DiscreteTransferFunction,
    DisturbanceObserver,
    Drift,
    Function,
    Gain,
    GridTable,
    Ground,
    IntegralSlidingMode,
    Integrator,
    LimitedIntegrator,
    MatrixGain,
    Noise,
    Pulse,
    PythonFunction,
    Quantizer,
    Quintic,
    Ramp,
    RateBoundedAllocation,
    RateLimiter,
    Relay,
    RetimedQuintic,
    RigidBody,
    Saturation,
    ShapedTrajectory,
    Sine,
    StateMachine,
    StateSpace,
    Step,
    StopWhen,
    Sum,
    Switch,
    Table,
    Terminator,
    TimeFunction,
    TimeTable,
    TransferFunction,
    TransportDelay,
    Trapezoid,
    UdpReceive,
    UdpSend,
    UnitDelay,
    VariableDelay,
    Waypoints,
    WeightedAllocation,
    ZeroOrderHold,
    control,
    enabled,
    simulate,
)
from trussflow.blocks.control import ExtendedKalmanFilter, KalmanFilter, LinearProcess
from trussflow.blocks.errors import DiagramError
from trussflow.blocks.framework.declarations import History
from trussflow.blocks.framework.system import flatten
from trussflow.blocks.testing import check_block

A = 0.3 * np.array([[-1.0, 2.0, 0.0], [-2.0, -1.0, 0.5], [0.0, 0.1, -0.5]])
P = np.array([[1.0, 0.5, 0.0, 0.2], [0.0, 1.0, 0.3, -0.4]])
PROCESS = LinearProcess(
    A, np.ones((3, 2)), np.eye(2, 3), every=0.05, covariance=0.1, noise=[0.1, 0.2]
)


def smooth():
    """Return a diagram of all blocks without events; most signals have two elements."""
    d = Diagram("smooth")
    d.add(
        constant=Constant([0.3, -0.2]),
        zero=Ground(2),
        step=Step(0.25, final_value=[1.0, -1.0]),
        ramp=Ramp([0.1, 0.2]),
        sine=Sine([1.0, 2.0], 0.7, bias=0.1),
        time_table=TimeTable([0.0, 0.25, 0.45], [[0.0, 1.0], [2.0, 3.0], [-1.0, 0.0]]),
        clock=TimeFunction(lambda t: t),
        noise=Noise([0.1, 0.2], 0.05, seed=1),
        drift=Drift(
            0.1, 0.05, seed=1, shape=2, correlation_time=1.0, initial_deviation=0.2
        ),
        quintic=Quintic([1.0, -1.0], 0.4),
        retimed=RetimedQuintic([1.0, -1.0], 0.4, 0.05),
        trapezoid=Trapezoid([1.0, -1.0], 4.0, 32.0),
        shaped=ShapedTrajectory(Trapezoid([1.0, -1.0], 4.0, 32.0), 8.0, damping=0.1),
        waypoints=Waypoints([0.0, 0.2, 0.45], [[0, 1], [1, 0], [0, 0]], stop=False),
    )
    d.add(
        gain=Gain([2.0, 3.0]),
        matrix_gain=MatrixGain([[1.0, 2.0], [3.0, -1.0]]),
        saturation=Saturation(-0.5, 0.8),
        dead_zone=DeadZone(-0.5, 0.8),
        rate_limiter=RateLimiter(2.0, 0.05),
        backlash=Backlash(0.3, 0.05),
        delay=TransportDelay(0.1, [0.0, 0.0]),
        variable_delay=VariableDelay(0.1, 0.5, [0.0, 0.0]),
        quantizer=Quantizer(0.1, 0.05, hysteresis=0.2),
        table=Table([-1.0, 0.0, 2.0], [1.0, 0.0, 3.0]),
        grid=GridTable(
            [[0.0, 0.3, 2.0], [-3.0, 3.0]], [[0.0, 1.0], [2.0, 1.0], [0.0, 3.0]]
        ),
        integrator=Integrator(1.0),
        unit_delay=UnitDelay(0.1),
        hold=ZeroOrderHold(0.05),
        added=Sum("+-+"),
        function=Function(np.tanh),
        python=PythonFunction(lambda u: u.max(), 0.1, **ports(u=2, y=())),
        terminator=Terminator(),
        send=UdpSend(0.1, 9),  # the port at which packets are discarded
        receive=UdpReceive(0.1, 0),
        state_space=StateSpace(A, np.ones((3, 2)), np.eye(3)),
        discrete_state_space=DiscreteStateSpace(
            A, np.ones((3, 2)), np.eye(3), sample_time=0.05
        ),
        transfer=TransferFunction([1.0], [0.1, 1.0]),
        discrete_transfer=DiscreteTransferFunction([1.0], [1.0, -0.5], sample_time=0.1),
        body=RigidBody(2.0, [1.0, 2.0, 3.0], rate=[0.1, 1.0, 0.2]),
        integral=IntegralSlidingMode(
            gamma=1.0, mu=0.25, beta=0.9, eta=0.1, sigma=0.3, boundary_layer=0.1
        ),
        conventional=ConventionalSlidingMode(slope=2.0, eta=0.1, boundary_layer=0.1),
        pd=PD(4.0, 2.0),
        observer=DisturbanceObserver(4.0),
        steady=KalmanFilter(PROCESS),
        varying=ExtendedKalmanFilter(PROCESS, initial_covariance=1.0),
        allocation=WeightedAllocation(2, [1.0, 2.0, 3.0, 4.0]),
        bounded=BoundedAllocation(2, np.full(4, 0.01)),
        rate_bounded=RateBoundedAllocation(2, np.full(4, 0.01), np.full(4, 3.0), 0.05),
    )
    connect(
        d,
        position=d.waypoints.position,
        velocity=d.waypoints.velocity,
        delay=d.clock.y,
        effectiveness=Constant(P),
        spread=Constant(np.eye(2)),
        lower=Constant(np.full(4, -0.2)),
        upper=Constant([0.1, 0.2, 0.3, 0.4]),
    )
    return d


def connect(d, **sources):
    """Connect inputs to the source of their name; the others to a sine, or to several values of it."""
    for name, source in sources.items():
        if isinstance(source, Block):
            sources[name] = d.add(f"{name}_source", source).y
    for block in list(d.blocks.values()):
        for port in block.inputs():
            if port.name in sources:
                sources[port.name] >> port
            elif port.shape == (3,):
                d.state_space.y >> port
            elif port.declaration.default is None:
                (d.sine.y[0] if port.shape == () else d.sine.y) >> port


def switching():
    """Return a diagram of the blocks with events: few blocks, because NumPy locates events slowly."""
    d = Diagram("switching")
    d.add(
        sine=Sine([1.0, 2.0], 1.4),
        pulse=Pulse(0.15, 0.4),
        clock=TimeFunction(lambda t: t),
        relay=Relay(0.3, -0.3),
        limited=LimitedIntegrator(lower=-0.1, upper=0.2),
        switch=Switch(),
        machine=StateMachine({"low": {"high": "up"}, "up": {}}, 0.05),
        pid=PID(2.0, 1.0, 0.1, filter_time=0.2),
        sampled_pid=DiscretePID(2.0, 1.0, 0.1, sample_time=0.05),
    )
    connect(d, control=d.pulse.y, u1=d.clock.y, high=d.switch.y, measurement=d.relay.y)
    (d.sine.y[0] > 0.1) >> d.add("duration", Integrator())
    (d.clock.y - 2.0) >> d.add("stop", StopWhen())
    return d


MAKERS = [smooth, switching]
BLOCKS = {
    path: block for make in MAKERS for path, block in flatten(make()).blocks.items()
}


def test_every_exported_block_is_in_a_diagram():
    exported = {
        name
        for name, item in [*vars(library).items(), *vars(control).items()]
        if isinstance(item, type) and issubclass(item, Block)
    }
    present = {type(block).__name__ for block in BLOCKS.values()}
    assert exported - present == {"Block", "Diagram"}


def run(make, backend, **settings):
    """Simulate a diagram over all times at which its sources change."""
    settings = {"step": 0.05, "solver": "euler", **settings}
    return simulate(make(), 0.55, log_step=0.05, backend=backend, **settings)


def assert_equal_runs(result, reference):
    assert set(result) == set(reference)
    for name, values in reference.items():
        assert_near(result[name], values, 1e-9, err_msg=str(name))
        assert np.isfinite(values).all(), name


@pytest.fixture(scope="module", params=MAKERS)
def reference(request):
    return request.param, run(request.param, "numpy")


@pytest.mark.parametrize("backend", ["interpreted", "compiled"])
def test_traced_blocks_do_what_numpy_does(backend, reference):
    make, expected = reference
    assert_equal_runs(run(make, backend), expected)


@pytest.mark.campaign
@pytest.mark.parametrize("make", MAKERS)
def test_traced_blocks_do_what_numpy_does_with_short_steps(make):
    settings = {"step": 0.01, "solver": "rk4"}
    assert_equal_runs(run(make, "compiled", **settings), run(make, "numpy", **settings))


@pytest.mark.parametrize(
    "code, allowed",
    [
        ("import trussflow.blocks, trussflow.models.transport", set()),
        (
            "import trussflow.blocks as b; loop = b.Diagram('loop'); loop.add(one=b.Constant(1.0)); "
            "b.simulate(loop, 1.0, step=0.1)",
            {"ssl", "xarray"},
        ),
    ],
)
def test_import_is_light(code, allowed):
    """What only some users need is imported when they need it.

    Where dask and pint are installed, xarray imports them for every array that it is to recognize.
    """
    heavy = {
        "control",
        "dask",
        "matplotlib",
        "netCDF4",
        "pint",
        "scipy.linalg",
        "scipy.sparse",
        "ssl",
        "xarray",
    }
    code += f"; import sys; print(*{heavy} & sys.modules.keys())"
    done = subprocess.check_output([sys.executable, "-c", code], text=True)
    assert set(done.split()) <= allowed


AROUND = {"lower": -1.0, "upper": 1.0, "spread": np.eye(2), "effectiveness": P}


@pytest.mark.parametrize("path", BLOCKS)
def test_every_block_of_the_library_passes(path):
    """Compiled they are compared in a whole diagram, elsewhere."""
    needs_metric = path in ("bounded", "rate_bounded")
    report = check_block(BLOCKS[path], around=AROUND if needs_metric else {})
    assert not report.failures, report


@pytest.mark.filterwarnings("ignore:.* jumps at t = ")
@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("backend", ["interpreted", campaign.only("compiled")])
def test_every_block_runs_in_a_group_or_is_refused_by_name(make, backend):
    """Each one in a group of its own, in the place of the block among the others."""
    diagram, spare = make(), make()
    command = diagram.add("command", Pulse(0.3, 0.5, delay=0.07))
    for name, block in [*spare.blocks.items()]:
        spare.remove(name)
        group = series("group", inner=block)
        group.expose(
            **{p.name: p for p in block.ports.values() if p.declaration.default is None}
        )
        if not block.traced or block.declared(History):
            with pytest.raises(
                DiagramError, match=rf"'inner' \({type(block).__name__}\)"
            ):
                enabled(group)
            continue
        enabled(group)
        if "enable" in group.ports:
            # Others still see the source itself, where a group would show zeros before its first edge.
            diagram.add(name if block.inputs() else f"{name}_group", group)
            command >> group.enable
    assert_equal_runs(*(run(lambda: diagram, each) for each in (backend, "numpy")))
