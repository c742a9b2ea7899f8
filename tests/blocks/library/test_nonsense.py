"""Nonsense handed to every public constructor and entry point is refused by one of our errors.

The call itself is Python's: a keyword that does not exist, or an argument that is missing or given
twice, stays a TypeError of Python's own, which names function and argument.

The campaign makes more calls.
"""

import inspect
import random
import warnings
from collections import Counter

import campaign
import control
import numpy as np
import pytest
from nonsense import NONSENSE
from refused import check_refused, over_calls
from systems import series

import trussflow.blocks as library
from trussflow.blocks import (
    Block,
    Constant,
    CoSimulator,
    Diagram,
    Gain,
    Input,
    Integrator,
    OperatingPoint,
    Output,
    Parameter,
    Session,
    Simulator,
    State,
    delay_margin,
    estimated_response,
    frequency_response,
    simulate,
    trim,
)
from trussflow.blocks.errors import BlockError, TrussflowError
from trussflow.blocks.linear_analysis.linearize import Linearizer
from trussflow.blocks.results.dataset import save
from trussflow.blocks.support.validation import shown

CALL_COUNT = 300 * campaign.SIZE


def ordinary():
    """Return what makes sense somewhere, so that calls come further."""
    return [
        *(
            1.0,
            2,
            0.1,
            [1.0, 2.0],
            [[1.0, 0.0], [0.0, 1.0]],
            "m",
            "N",
            ("m", "N"),
            (2,),
            "+-",
            "*/",
            np.abs,
        ),
        *(
            [0.0, 1.0, 2.0],
            {"u": Input()},
            {"y": Output()},
            1,
            "auto",
            "rk4",
            "block.y",
            ["i.y"],
            {"g.gain": 3.0},
        ),
    ]


def small():
    return series(one=Constant(1.0), g=Gain(2.0), i=Integrator())


def entry_points():
    """Return the constructors of all public blocks, and what else takes values of users."""

    class Own(Block):
        u = Input()
        y = Output()
        x = State()
        k = Parameter(1.0, minimum=0.0)

    ready = Simulator(small(), step=0.1)
    session = Session(small(), step=0.1)
    session.start()
    blocks = [
        v
        for v in vars(library).values()
        if inspect.isclass(v) and issubclass(v, Block) and v is not Block
    ]
    port = small().g.u

    def declared(shape=(), unit=None):
        class Declared(Block):
            u = Input(shape, unit=unit)
            y = Output(shape, unit=unit)

        return Declared()

    def run(duration, step=0.1, **more):
        return simulate(small(), duration, step=step, **more)

    others = [
        *[
            Own,
            declared,
            lambda index=0: small().g.u[index],
            lambda name="x": Diagram(name),
        ],
        lambda log=None, log_step=None, solver="rk4": run(
            0.1, log=log, log_step=log_step, solver=solver
        ),
        lambda duration=1.0, step=0.1: (
            run(duration, step) if not _long(duration, step) else None
        ),
        lambda parameters=None, initial=None: ready.run(
            0.1, parameters=parameters, initial=initial
        ),
        lambda not_finite="warn": ready.run(0.1, not_finite=not_finite),
        *[lambda values=None: session.set(values), lambda p=None: session.tune(p)],
        lambda parameters=None, initial=None: session.start(
            parameters=parameters, initial=initial
        ),
        lambda every=0.1, offset=0.0: Gain(1.0).sampled(every, offset),
        *[
            lambda x=0: x >> small().g.u,
            lambda x=0: small().g.y * x,
            lambda x=0: x - small().g.y,
        ],
        *[lambda x=0: small().g + x, lambda x=0: port < x],
        *[lambda b=0: small().add(b=b), lambda x=0: small().add(x)],
        *[lambda a=0: small().expose(a=a), lambda x=0: small().ground(x)],
        lambda source=0, target=0: small().connect(source, target),
        *[library.sampled_delay, session.restore],
    ]
    return [*blocks, *others, *analyses()]


LAG = control.ss([[-1.0]], [[1.0]], [[0.5]], [[0.0]])

FIVE = 5


def adaptive(rtol=1e-3, progress=False):
    return simulate(small(), 0.1, solver="RK45", rtol=rtol, progress=progress)


def coupled(**settings):
    return CoSimulator(small(), **{"step": 0.1, "backend": "numpy", **settings})


def analyses():
    """Return the entry points of analyses and of co-simulation."""
    linear = Linearizer(small(), ["g.u"], ["i.y"])

    def estimated(omega=60.0, seed=0, at=None, amplitude=1.0):
        settings = {"omega": omega, "seed": seed, "at": at, "amplitude": amplitude}
        return estimated_response(Gain(1.0), "u", step=0.01, **settings)

    return [
        lambda members=(), order=None, parameters=None, initial=None: coupled(
            members=members, order=order, parameters=parameters, initial=initial
        ),
        lambda step=0.1, tolerance=None, largest_step=None: coupled(
            step=step, tolerance=tolerance, largest_step=largest_step
        ),
        lambda at=None: linear.at(at),
        lambda at=None, states=None, inputs=None: trim(
            small(), at=at, states=states, inputs=inputs
        ),
        lambda loop=LAG, omega=None: delay_margin(loop, omega=omega),
        lambda omega=1.0: frequency_response(small(), "g.u", "i.y", omega=omega),
        lambda path="": save(FIVE, path),
        lambda time=0.0: OperatingPoint(time=time),
        estimated,
        adaptive,
    ]


def _long(duration, step):
    """Tell whether a run would only be long."""
    try:
        return float(duration) / float(step) > 1e4
    except (TypeError, ValueError, ArithmeticError):
        return False


def call(function, random_):
    """Call a function with nonsense; return what came, and fail on an error that is not ours."""
    chosen = {}
    for name, parameter in inspect.signature(function).parameters.items():
        wanted = parameter.kind not in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD)
        if wanted and (parameter.default is parameter.empty or random_.random() < 0.5):
            chosen[name] = random_.choice(
                NONSENSE if random_.random() < 0.5 else ordinary()
            )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            result = function(**chosen)
            if isinstance(result, Block) and not isinstance(result, Diagram):
                diagram = series(block=result)
                diagram.ground(*result.inputs())
                simulate(diagram, 0.1, step=0.1, backend="numpy", not_finite="ignore")
    except TrussflowError as error:
        return type(error).__name__
    except Exception as error:
        what = f"{getattr(function, '__name__', function)}({shown(chosen)})"
        raise AssertionError(
            f"{what} raised {type(error).__name__}: {shown(error)}"
        ) from error
    return "accepted"


@pytest.mark.parametrize("part", [0, *map(campaign.only, range(1, 4))])
def test_nonsense_is_refused_by_our_errors(part):
    functions, found = entry_points(), Counter[str]()
    for number in range(CALL_COUNT):
        random_ = random.Random(f"{campaign.SEED} {part} {number}")
        found[call(random_.choice(functions), random_)] += 1
    assert found["accepted"] < found.total(), found


class Named(Block):
    u = Input()

    def __init__(self, name):
        setattr(self, name, 5)
        super().__init__()


@pytest.mark.parametrize(
    "name", ["states", "ports", "output", "path", "name", "sample_time", "_shape"]
)
def test_names_of_blocks_are_not_taken(name):
    """Block's own code calls its methods: a number in their place would fail much later."""
    with pytest.raises(
        BlockError,
        match=rf"Named sets '{name}', but every block has Block\.{name}; choose",
    ):
        Named(name)
    assert vars(Named("size"))["size"] == 5


@over_calls(__file__)
def test_what_was_taken_in_silence_or_refused_by_others(call, error, message):
    check_refused(call, error, message, globals())
