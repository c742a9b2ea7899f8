"""Every operation in C: numbers and lanes, ordinary operands and the edges of their range."""

import ctypes
from itertools import product

import campaign
import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from systems import compiled_program

from trussflow.blocks.tracing.codegen import vector_functions as declarations
from trussflow.blocks.tracing.compiler import compile_library
from trussflow.blocks.tracing.kernels import (
    from_expression,
    repeated,
    symbol,
    to_expression,
    tracing,
)
from trussflow.blocks.tracing.operations import FORMULAS

FUNCTION_ERROR = (
    3.0  # units in the last place: of the series, and of NumPy's own functions
)
POWER_ERROR = 45.0  # the same for a power, whose logarithm is multiplied by up to 20

NAMES = {number: name for name, number in vars(ca).items() if name.startswith("OP_")}
OPERATIONS = {NAMES[number]: number for number in FORMULAS if number >= 0}

ORDINARY_NUMBERS = (0.7, -0.7, 3.5, -2.0, 1.0, 5e4)
EXTREME_NUMBERS = (
    0.0,
    -0.0,
    1e-310,
    -1e-310,
    1e200,
    -1e200,
    1e308,
    np.inf,
    -np.inf,
    np.nan,
)
OPERANDS = np.array(list(product(ORDINARY_NUMBERS + EXTREME_NUMBERS, repeat=2)))


def apply(operation, a, b):
    """Return the expression that consists of one operation."""
    binary = "{1}" in FORMULAS[operation]
    return ca.SX.binary(operation, a, b) if binary else ca.SX.unary(operation, a)


def everything(a, b):
    """Return the results of all operations on two numbers."""
    first, second = to_expression(a), to_expression(b)
    column = ca.vertcat(*(apply(o, first, second) for o in OPERATIONS.values()))
    return (from_expression(column, (len(OPERATIONS),)),)


def compiled(count):
    """Return the results of all operations on all operands, `count` pairs at a time."""
    pairs = symbol("x", (2 * count,))
    instances = [(pairs[2 * i], pairs[2 * i + 1]) for i in range(count)]
    with tracing() as trace:
        results = [to_expression(r) for (r,) in repeated(everything, instances)]
    assert len(trace) == (count > 1)
    _, call = compiled_program(results, pairs, trace)
    found = [
        call(np.resize(OPERANDS[i:], 2 * count)) for i in range(0, len(OPERANDS), count)
    ]
    return np.concatenate(found).reshape(-1, len(OPERATIONS))[: len(OPERANDS)]


LOSE_NAN = {"OP_FMIN": np.minimum, "OP_FMAX": np.maximum}
"""Operations in which CasADi's interpreter loses NaN, and NumPy's functions in their place."""


@pytest.mark.parametrize("count", [1, 3, 4, 7, 9, *map(campaign.only, (2, 5, 6, 8))])
def test_c_does_what_the_interpreter_does(count):
    """Numbers (1), two lanes (2, 3), four lanes (the others), and groups that overlap."""
    a, b = OPERANDS.T
    x, y = ca.SX.sym("a"), ca.SX.sym("b")
    found = compiled(count)
    with np.errstate(all="ignore"):
        for column, (name, operation) in enumerate(OPERATIONS.items()):
            function = LOSE_NAN.get(name) or ca.Function(
                "one", [x, y], [apply(operation, x, y)]
            )
            expected = np.asarray(function(a, b)).ravel()
            tolerance = POWER_ERROR if "POW" in name else FUNCTION_ERROR
            assert_allclose(
                found[:, column],
                expected,
                rtol=tolerance * np.finfo(float).eps,
                err_msg=name,
            )


def test_every_numpy_function_that_can_be_traced_has_its_c():
    """A new version of CasADi may bring more."""
    a, b = symbol("a", (2,)), symbol("b", (2,))
    known = {ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST} | set(OPERATIONS.values())
    reached = set()
    for ufunc in (
        f for f in vars(np).values() if isinstance(f, np.ufunc) and f.nout == 1
    ):
        try:
            result = ufunc(*(a, b)[: ufunc.nin])
        except TypeError:  # CasADi has nothing like it
            continue
        function = ca.Function(
            "f", [to_expression(a), to_expression(b)], [to_expression(result)]
        )
        used = {function.instruction_id(k) for k in range(function.n_instructions())}
        assert used <= known, ufunc.__name__
        reached |= used
    assert len(reached) > 40


# -- the functions that lanes.h has of its own ------------------------------------------------

FUNCTIONS = {
    "sin": np.sin,
    "cos": np.cos,
    "exp": np.exp,
    "log": np.log,
    "pow": np.power,
}
ERROR_LIMITS = dict.fromkeys(FUNCTIONS, FUNCTION_ERROR) | {"pow": POWER_ERROR}


@pytest.fixture(scope="module")
def lanes():
    """Return a caller of the functions in lanes.h."""
    source = declarations()
    for (name, function), width in product(FUNCTIONS.items(), (2, 4)):
        given = ", ".join(
            f"*(const tf_lanes{width}*)({v} + i)" for v in "ab"[: function.nin]
        )
        source += (
            f"\nvoid {name}_{width}(const double* a, const double* b, double* r, long long n) {{\n"
            f"  for (long long i = 0; i < n; i += {width})\n"
            f"    *(tf_lanes{width}*)(r + i) = tf_{width}_{name}({given});\n}}\n"
        )
    library = ctypes.CDLL(str(compile_library(source, lambda: [source])))

    def call(name, width, *arguments):
        n = len(arguments[0])
        assert n % width == 0
        result = np.empty(n)
        vectors = [arguments[0], arguments[-1], result]
        addresses = [ctypes.c_void_p(v.ctypes.data) for v in vectors]
        library[f"{name}_{width}"](*addresses, ctypes.c_longlong(n))
        return result

    return call


def loguniform(low, high):
    """Return numbers between two powers of ten."""
    return 10.0 ** np.random.default_rng(2).uniform(low, high, 40_000)


def between(low, high):
    """Return numbers between two others, in another order than those of `loguniform`."""
    return np.random.default_rng(3).uniform(low, high, 40_000)


RANGES = {
    "sin of any angle": ("sin", between(-1e5, 1e5)),
    "sin of tiny angles": ("sin", loguniform(-300, 0)),
    "sin at its zeros": ("sin", np.arange(-60_000, 60_000) * np.pi),
    "sin at its extremes": ("sin", (np.arange(-31_000, 31_000) + 0.5) * np.pi),
    "cos of any angle": ("cos", between(-1e5, 1e5)),
    "cos at its zeros": ("cos", (np.arange(-31_000, 31_000) + 0.5) * np.pi),
    "sin by libm": ("sin", loguniform(4.9, 20)),
    "cos by libm": ("cos", -loguniform(4.9, 20)),
    "exp": ("exp", between(-700.0, 700.0)),
    "exp of little": ("exp", between(-1.0, 1.0)),
    "exp by libm": ("exp", between(-760.0, -690.0)),
    "log": ("log", loguniform(-300, 300)),
    "log near one": ("log", 1.0 + between(-0.4, 0.5)),
    "log at one": ("log", 1.0 + loguniform(-16, -1)),
    "log by libm": ("log", loguniform(-323, -299)),
    "fractional power": ("pow", loguniform(-6, 6), between(0.1, 1.4)),
    "power near one": ("pow", 1.0 + between(-0.3, 0.4), loguniform(-3, 2)),
    "power by libm": ("pow", loguniform(-3, 3), between(-40.0, 40.0)),
}


@pytest.mark.parametrize("width", [2, 4])
@pytest.mark.parametrize("name", RANGES)
def test_functions_of_lanes_are_accurate(name, width, lanes):
    """Against NumPy in extended precision, where the processor has it."""
    function, *arguments = RANGES[name]
    found = lanes(function, width, *arguments)
    expected = FUNCTIONS[function](*(v.astype(np.longdouble) for v in arguments))
    error = np.abs(found - expected) / np.spacing(np.abs(expected.astype(float)))
    assert error.max() < ERROR_LIMITS[function], [
        v[np.argmax(error)] for v in arguments
    ]


@pytest.mark.parametrize("width", [2, 4])
@pytest.mark.parametrize("function", FUNCTIONS)
def test_one_lane_at_the_edge_leaves_the_others_right(function, width, lanes):
    edges = np.array(
        [np.nan, np.inf, -np.inf, 0.0, -0.0, -1.0, 1e308, 5e-324, 1e5, 750.0, -750.0]
    )
    for lane in range(width):
        first = np.full((len(edges), width), 0.7)
        first[:, lane] = edges
        second = np.full(first.size, 1.5)
        arguments = [first.ravel(), second][: FUNCTIONS[function].nin]
        with np.errstate(all="ignore"):
            expected = FUNCTIONS[function](*arguments)
        tolerance = ERROR_LIMITS[function] * np.finfo(float).eps
        found = lanes(function, width, *arguments)
        assert_allclose(found, expected, rtol=tolerance)


@pytest.mark.parametrize("count", [1, 3])
def test_remainders_of_products_stay_in_their_range(count):
    """A product that is rounded only after the remainder is taken off leaves the range by 1e-17."""
    x, modulus = symbol("x", (count,)), 0.1
    parts = [np.mod(x * 0.3, modulus), x % modulus, np.rint(x * 10.0)]
    _, call = compiled_program(map(to_expression, parts), x)
    for number in np.random.default_rng(0).integers(0, 2000, 2000) / 20.0:
        tenfold = number * 10.0
        expected = [np.mod(number * 0.3, modulus), number % modulus, np.rint(tenfold)]
        found = call(np.full(count, number)).reshape(3, count)
        assert_array_equal(found, np.outer(expected, np.ones(count)))
