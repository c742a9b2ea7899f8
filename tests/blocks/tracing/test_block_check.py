"""One block by itself: what cannot be traced is refused, with its name and what to do."""

import inspect
import math
import tracemalloc

import numpy as np
import pytest
from scipy.special import expit

from trussflow.blocks.errors import BlockError, TracingError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Parameter, State
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.tracing.block_check import isolate
from trussflow.blocks.tracing.kernels import is_traced


def block_of(equation, size=3):
    """Return a block in a diagram with y = equation(u)."""

    class Custom(Block):
        u = Input((size,))
        y = Output((size,))

        def output(self, t, x, u, p):
            return {"y": equation(u.u)}

    return Diagram("d").add(custom=Custom())


def assigned(u):
    y = np.zeros(3)
    for i in range(3):
        y[i] = u[i]
    return y


def overwritten(u):
    u[0] = 9.0
    return u


def added_in_place(u):
    u += 1.0
    return u


def random(u):
    return u + np.random.default_rng().random(3)


@pytest.mark.parametrize(
    "equation, advice",
    [
        (lambda u: u if u[0] > 0 else -u, "np.where instead of 'if'"),
        (
            lambda u: max(u[0], 0.0) * u,
            "np.maximum and np.minimum instead of max() and min()",
        ),
        (
            lambda u: u if u[0] > 0 and u[1] > 0 else -u,
            "np.logical_and and np.logical_or",
        ),
        (
            lambda u: np.where((u > 0.0) & (u < 0.5), u, -u),
            "write np.logical_and, np.logical_or",
        ),
        (assigned, "write np.stack, np.concatenate or np.where"),
        (overwritten, "write np.stack, np.concatenate or np.where"),
        (added_in_place, "write np.stack, np.concatenate or np.where"),
        (lambda u: u * float(u[0]), "leave float() out"),
        # float() of a symbol is NaN, so one branch would be taken.
        (lambda u: u if float(u[0]) > 0 else -u, "leave float() out"),
        (lambda u: u * math.sin(u[0]), "np.sin instead of math.sin"),
        (lambda u: np.array([u[0], u[1], u[2]]), "write np.stack or np.concatenate"),
        (
            lambda u: u * np.arange(3.0)[int(u[0])],
            "write np.where or np.select to choose",
        ),
        (lambda u: np.sort(u), "np.sort does not trace"),
        (lambda u: u * np.argmax(u), "np.argmax does not trace"),
        (
            lambda u: u * np.searchsorted([0.0, 1.0], u),
            "np.searchsorted does not trace",
        ),
        (lambda u: expit(u), "expit() of another library does not trace"),
        (random, "traced and NumPy values of 'output.y'"),
    ],
)
def test_equations_that_cannot_be_traced_are_refused(equation, advice):
    with pytest.raises(TracingError) as error:
        isolate(block_of(equation))
    head, place, last = str(error.value).split("\n")
    assert head.startswith(
        "the equations of block 'custom' (Custom) cannot be traced: "
    )
    assert advice in head
    if equation is not random:  # the place is the call, not where values differ
        lines, first = inspect.getsourcelines(equation)
        path, number, text = place.split(":", 2)
        assert path.endswith(__file__)
        assert text.strip() == lines[int(number) - first].strip()
    assert last.startswith(
        "  docs/traceable.md lists the supported operations; a Python block"
    )


@pytest.mark.parametrize(
    "equation",
    [
        lambda u: np.concatenate([u[1:], u[:1]]),
        lambda u: np.cross(u, [1.0, 2.0, 3.0]),
        lambda u: np.eye(3) @ u / np.linalg.norm(u),
        lambda u: u @ np.reshape(np.concatenate([u, u, u]), (3, 3)),
        lambda _: np.arange(3.0),
        # finite where NumPy has NaN, as the README says
        lambda u: u / u + (u - u) + 0.0 * u,
        # hangs on the sign of zero
        lambda u: np.arctan2(np.where(u > 1.0, u, -u), -1.0),
        lambda u: np.sin(u * 1e9),
        lambda u: np.linalg.solve(np.outer(u, u) + np.diag(u), u),
    ],
)
def test_ordinary_equations_are_accepted(equation):
    assert isolate(block_of(equation)).feedthrough.keys() == {"y"}


def test_values_that_differ_are_told():
    with pytest.raises(
        TracingError,
        match=r"values of 'output.y' \(element 0\) differ: 1 traced, 2 in NumPy",
    ):
        isolate(
            block_of(lambda u: np.ones(3) * (2.0 if isinstance(u, np.ndarray) else 1.0))
        )


@pytest.mark.parametrize(
    "equation",
    [
        lambda u: np.where(u != u, 0.0, u),
        lambda u: np.where(np.abs(u) > 100.0, 0.0, u) if is_traced(u) else u,
        lambda u: np.where(np.isinf(u), float(is_traced(u)), u),
        lambda u: np.where(u == 0.0, 1.0, u) if is_traced(u) else u,
        lambda u: np.where(u[0] == u[1], 1.0, u) if is_traced(u) else u,
    ],
    ids=["NaN", "large", "infinite", "zero", "equal"],
)
def test_values_are_compared_at_special_points(equation):
    with pytest.raises(TracingError, match=r"traced and NumPy values of 'output\.y'"):
        isolate(block_of(equation))


@pytest.mark.parametrize(
    "returned", [None, "text", [1.0, None, 2.0], np.ma.masked_array(np.ones(3)), 1j]
)
def test_what_is_no_array_of_numbers_is_refused(returned):
    with pytest.raises(
        BlockError,
        match=r"'y' must be an array of numbers, not (?s:.*)test_block_check.py:",
    ):
        isolate(block_of(lambda _: returned))


def test_error_in_numpy_is_told():
    def fails(u):
        if isinstance(u, np.ndarray):
            raise RuntimeError("numbers only")
        return u

    with pytest.raises(
        TracingError,
        match=r"in NumPy, with random numbers: RuntimeError: numbers only\n.*raise Run",
    ):
        isolate(block_of(fails))


def test_random_matrix_without_a_solution_proves_nothing():
    """A block may need a positive definite matrix, which random inputs are not."""

    class Solver(Block):
        matrix = Input((2, 2))
        y = Output((2,))

        def output(self, t, x, u, p):
            if isinstance(u.matrix, np.ndarray):
                np.linalg.cholesky(u.matrix)
            return {"y": np.linalg.solve(u.matrix, np.ones(2))}

    assert isolate(Diagram("d").add(b=Solver())).feedthrough == {
        "y": frozenset({"matrix"})
    }


class Wrong(Block):
    u = Input()
    y = Output((2,))
    q = State((3,))
    gain = Parameter(1.0)

    def __init__(self, returned, rate=None):
        self.returned, self.rate = returned, rate
        super().__init__()

    def output(self, t, x, u, p):
        return self.returned

    def derivative(self, t, x, u, p):
        return self.rate


@pytest.mark.parametrize(
    "block, message",
    [
        (
            Wrong(None),
            r"output\(\) of block 'b' \(Wrong\) must return a dict of: y; .*'NoneType'",
        ),
        (Wrong({"z": 1.0}), "must return a dict of: y; it returned: z"),
        (Wrong({}), "must return a dict of: y; it returned: $"),
        (
            Wrong({"y": np.ones(3)}),
            r"'y' is declared with shape \(2,\), but was .* shape \(3,\)",
        ),
        (
            Wrong({"y": np.ones(2)}, {}),
            r"derivative\(\) of block 'b' .* must return a dict of: q",
        ),
        (
            Wrong({"y": np.ones(2)}, {"q": np.ones((3, 1))}),
            r"'q' is .*returned with shape \(3, 1\)",
        ),
    ],
)
def test_what_equations_return_is_checked(block, message):
    with pytest.raises(BlockError, match=message):
        isolate(Diagram("d").add(b=block))


def test_misspelt_names_in_equations_are_told():
    class Misspelt(Block):
        force = Input()
        y = Output()

        def output(self, t, x, u, p):
            return {"y": u.forces}

    with pytest.raises(
        AttributeError, match="block 'b' has no 'forces'; it has: force"
    ):
        isolate(Diagram("d").add(b=Misspelt()))


def test_feedthrough_is_per_pair_of_ports():
    class Mixed(Block):
        u = Input((2,))
        v = Input()
        w = Input()
        direct = Output((2,))
        state = Output()
        time = Output()
        product = Output()
        q = State()
        # a parameter that is zero now may be another number later
        gain = Parameter(0.0)

        def output(self, t, x, u, p):
            return {
                "direct": np.stack([u.u[0], u.v]),
                "state": x.q + 0.0 * u.w,
                "time": t * t,
                "product": p.gain * u.w,
            }

        def derivative(self, t, x, u, p):
            return {"q": u.w}

    assert isolate(Diagram("d").add(b=Mixed())).feedthrough == {
        "direct": frozenset({"u", "v"}),
        "state": frozenset(),
        "time": frozenset(),
        "product": frozenset({"w"}),
    }


@pytest.mark.parametrize(
    "declared", [{}, {"y": ("v",)}, {"y": (), "z": ()}, {"z": ("u",)}]
)
def test_feedthrough_of_python_blocks_is_declared_and_checked(declared):
    class Python(Block):
        traced = False
        u = Input()
        y = Output()

        def feedthrough(self):
            return declared

    with pytest.raises(
        BlockError, match=r"feedthrough\(\) of block 'b' returned .* outputs \(y\)"
    ):
        isolate(Diagram("d").add(b=Python()))


def test_many_elements_need_no_dense_matrix():
    """What depends on what, element by element, would take 400 MB."""
    block = block_of(lambda u: 2.0 * u, 20_000)
    tracemalloc.start()
    try:
        assert isolate(block).feedthrough == {"y": frozenset("u")}
        assert tracemalloc.get_traced_memory()[1] < 100e6
    finally:
        tracemalloc.stop()
