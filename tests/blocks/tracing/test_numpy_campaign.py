"""Random compositions of NumPy calls: traced ones agree with NumPy on all backends, or are refused."""

from __future__ import annotations

import functools
import inspect
import itertools
from collections import Counter
from dataclasses import dataclass

import campaign
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import compiled_program

from trussflow.blocks.errors import TrussflowError
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.library.algebra import Function
from trussflow.blocks.tracing.block_check import isolate
from trussflow.blocks.tracing.kernels import symbol, to_expression
from trussflow.blocks.tracing.numpy_functions import REFUSED_FUNCTIONS
from trussflow.blocks.tracing.traced_array import NeedsNumberError

BATCH_SIZE = 200
ROUND_OFF = 1e-9  # relative to the largest number on the way, whose last digits are lost where it cancels
VECTOR_SIZE = 3
T, X = symbol("t", ()), symbol("x", (2 * VECTOR_SIZE,))

UNARY_CALLS = [
    *(
        "abs",
        "sqrt",
        "square",
        "reciprocal",
        "sign",
        "exp",
        "expm1",
        "log",
        "log1p",
        "log10",
        "log2",
        "exp2",
    ),
    *("sin", "cos", "tan", "arcsin", "arccos", "arctan", "sinh", "cosh", "tanh"),
    *("arcsinh", "arccosh", "arctanh"),
    *(
        "floor",
        "ceil",
        "trunc",
        "fix",
        "rint",
        "round",
        "cbrt",
        "degrees",
        "radians",
        "sinc",
        "negative",
    ),
    *("isnan", "isinf", "isfinite", "logical_not", "cumsum", "cumprod"),
    *("flip", "ediff1d", "sort", "argmax", "positive"),
    *("max", "min", "sum", "mean", "prod", "ptp", "std", "var", "all", "any", "median"),
    "count_nonzero",
]
BINARY_CALLS = [
    *(
        "add",
        "subtract",
        "multiply",
        "divide",
        "power",
        "mod",
        "fmod",
        "floor_divide",
        "maximum",
        "minimum",
    ),
    *("arctan2", "hypot", "copysign"),
    *(
        "less",
        "less_equal",
        "greater",
        "greater_equal",
        "equal",
        "not_equal",
        "logical_and",
        "logical_or",
    ),
    *("logical_xor", "cross", "float_power", "nextafter"),
]
NUMBERS = (0.0, 1.0, -1.0, 0.5, 2.0, 3.0, 0.1, -2.5, 7.0, 1e-3, 1e6)
REFUSED_BY_NUMPY = (
    TypeError,
    ValueError,
    IndexError,
    AttributeError,
    OverflowError,
    np.linalg.LinAlgError,
)

SPECIAL_CALLS = {
    "where": lambda a, b, c: np.where(np.greater(a, 0), b, c),
    "clip": lambda a: np.clip(a, -1, 2),
    "interp": lambda a: np.interp(a, [-1, 0, 2], [3, 1, 4.0]),
    "round to tenths": lambda a: np.round(a, 1),
    "max initial": lambda a: np.max(a, initial=0.5),
    "%": lambda a, b: a % b,
    "**": lambda a, b: a**b,
    # NumPy's own rounds sums of products once, and loses the sign of zero in a number times a vector.
    "dot": lambda a, b: (
        np.sum(np.multiply(a, b)) if np.ndim(a) and np.ndim(b) else np.multiply(a, b)
    ),
    "select": lambda a, b: np.select([np.less(a, -1), np.less(a, 1)], [a, b], 0.5),
}


ARITY = (
    {name: f.__code__.co_argcount for name, f in SPECIAL_CALLS.items()}
    | dict.fromkeys(UNARY_CALLS, 1)
    | dict.fromkeys(BINARY_CALLS, 2)
)
FUNCTIONS = {
    name: getattr(np, name) for name in (*UNARY_CALLS, *BINARY_CALLS)
} | SPECIAL_CALLS


@dataclass(frozen=True)
class Node:
    """A call of a NumPy function, an input, or a number."""

    name: str
    operands: tuple[Node, ...] = ()

    def __str__(self):
        return (
            f"{self.name}({', '.join(map(str, self.operands))})"
            if self.operands
            else self.name
        )

    def __call__(self, u, v, watch=lambda _name, _operands, result: result):
        if not self.operands:
            return (
                {"u": u, "v": v}[self.name]
                if self.name in "uv"
                else np.float64(self.name)
            )
        operands = [each(u, v, watch) for each in self.operands]
        return watch(self.name, operands, FUNCTIONS[self.name](*operands))


def drawn(rng, depth):
    """Return a random composition."""
    if depth == 0 or rng.random() < 0.1:
        return Node(
            str(rng.choice([*"uvuv", *map(repr, NUMBERS[: rng.integers(1, 12)])]))
        )
    name = str(rng.choice([*UNARY_CALLS, *BINARY_CALLS, *BINARY_CALLS, *SPECIAL_CALLS]))
    return Node(name, tuple(drawn(rng, depth - 1) for _ in range(ARITY[name])))


def points():
    """Return ordinary, huge, tiny, infinite, NaN, equal and signed-zero inputs."""
    rng = np.random.default_rng(7)
    mixed = [
        0.0,
        -0.0,
        0.5,
        -2.5,
        3.5,
        1e300,
        -1e300,
        1e-300,
        -1e-290,
        np.inf,
        -np.inf,
        np.nan,
        1.0,
        -1.0,
        1e17,
    ]
    found = [rng.uniform(-3, 3, (2, VECTOR_SIZE)) for _ in range(4)]
    found += [rng.choice(mixed, (2, VECTOR_SIZE)) for _ in range(12)]
    found += [np.full((2, VECTOR_SIZE), a) for a in (0.5, 0.0, 2.0, np.inf, np.nan)]
    return found + [
        np.round(rng.uniform(-9, 9, (2, VECTOR_SIZE))) / [[2], [10]] for _ in range(4)
    ]


@dataclass
class Watch:
    """Observations on the way to NumPy's result."""

    largest: float = 1.0
    simplified: bool = (
        False  # CasADi may have simplified where NumPy gets NaN or infinity
    )
    interpreter: bool = False  # CasADi's interpreter drops NaN here

    def __call__(self, name, operands, result):
        nan = any(np.isnan(a).any() for a in operands)
        given = max(np.count_nonzero(~np.isfinite(a)) for a in operands)
        found = np.count_nonzero(~np.isfinite(result))
        self.simplified |= bool(found > given or (not nan and np.isnan(result).any()))
        self.simplified |= nan and name in ARITHMETIC
        # A power of one half is a square root, which has none of minus infinity.
        self.simplified |= name in {"power", "float_power"} and bool(
            np.isneginf(operands[0]).any()
        )
        self.simplified |= nan and name == "copysign"  # the sign of NaN means nothing
        self.interpreter |= nan and name in MAXIMA
        self.largest = np.abs(np.where(np.isfinite(result), result, 0.0)).max(
            initial=self.largest
        )
        return result


ARITHMETIC = {
    *(
        "add",
        "subtract",
        "multiply",
        "divide",
        "dot",
        "cross",
        "%",
        "fmod",
        "mod",
        "floor_divide",
    ),
    *(
        "less",
        "less_equal",
        "greater",
        "greater_equal",
        "equal",
        "not_equal",
        "ptp",
        "std",
        "var",
        "linalg.norm",
    ),
    *("power", "float_power", "**", "prod", "cumprod", "where", "select", "hypot"),
}
MEANS = {"mean", "var", "std"}
MAXIMA = {"maximum", "minimum", "clip", "max", "min", "amax", "amin", "ptp"}


def shaken(seed):
    """Return what brings round-off into each result on the way."""
    rng = np.random.default_rng(seed)

    def watch(name, _operands, result):
        shake = 1e-13 * rng.uniform(-1.0, 1.0, np.shape(result))
        if name in MEANS:  # also of equal numbers, from which nothing should differ
            return result + rng.integers(2) * np.abs(shake)
        return (
            result if np.asarray(result).dtype.kind in "bi" else result * (1.0 + shake)
        )

    return watch


def judged(node, u, v, found):
    """Return what is wrong with what the backends found at one point, if anything."""
    watch = Watch()
    expected = np.ravel(np.asarray(node(u, v, watch), dtype=float))
    if watch.simplified:
        return ""
    for backend, values in found.items():
        if backend == "interpreted" and watch.interpreter:
            continue
        same = (values == expected) | (np.isnan(values) & np.isnan(expected))
        if (same | (np.abs(values - expected) <= ROUND_OFF * watch.largest)).all():
            continue
        others = [
            node(u, v, lambda _n, _o, result: np.add(result, 0.0)),
            node(u + 0.0, v + 0.0),
        ]
        for k in range(4):
            factor = 1.0 + 1e-12 * np.random.default_rng(k).choice(
                [-1.0, 1.0], VECTOR_SIZE
            )
            others += [node(u * factor, v), node(u, v * factor), node(u, v, shaken(k))]
        spread = [np.ravel(np.asarray(other, dtype=float)) for other in others]
        if any(
            (
                (s != expected)
                & ~(np.abs(s - expected) <= ROUND_OFF * watch.largest)
                & ~np.isnan(expected)
            ).any()
            for s in spread
        ):
            continue  # round-off or the sign of zero decides
        return f"{node} at u = {u}, v = {v}: {backend} {values}, NumPy {expected}"
    return ""


def evaluated(batch, judge):
    """Return all that is wrong in a batch, evaluated as one program."""
    program, compiled = compiled_program([e for _, e in batch], X)
    wrong = []
    ends = np.cumsum([e.numel() for _, e in batch])[:-1]
    for u, v in points():
        x = np.concatenate([u, v])
        values = {
            "interpreted": np.asarray(
                program.function(0.0, x, np.zeros(0), np.zeros(0))
            ).ravel(),
            "compiled": compiled(x),
        }
        parts = {name: np.split(each, ends) for name, each in values.items()}
        for k, (node, _) in enumerate(batch):
            wrong.append(
                judge(node, u, v, {name: each[k] for name, each in parts.items()})
            )
    return [w for w in wrong if w]


def traced(node):
    """Return the expression of a composition; None if it is refused by one error of ours."""
    shape = np.shape(
        node(*np.random.default_rng(1).uniform(0.5, 1.0, (2, VECTOR_SIZE)))
    )
    block = Function(
        lambda u, v: node(u, v),
        {"u": Input(VECTOR_SIZE), "v": Input(VECTOR_SIZE)},
        {"y": Output(shape)},
    )
    Diagram("d").add(f=block)
    try:
        reusable = isolate(block).traced
    except TrussflowError:
        return None
    return to_expression(reusable([T, X[:VECTOR_SIZE], X[VECTOR_SIZE:]])["output"]["y"])


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("number", [150, campaign.only(500 * campaign.SIZE)])
def test_random_compositions_agree_or_are_refused(number):
    rng = np.random.default_rng(campaign.SEED)
    counts = Counter()
    batch = []
    wrong = []
    with np.errstate(all="ignore"):
        while counts["drawn"] < number:
            node = drawn(rng, rng.integers(1, 5))
            try:
                node(*np.random.default_rng(1).uniform(0.5, 1.0, (2, VECTOR_SIZE)))
            except REFUSED_BY_NUMPY:
                continue  # NumPy refuses it as well
            counts["drawn"] += 1
            expression = traced(node)
            counts["refused" if expression is None else "accepted"] += 1
            if expression is not None:
                batch.append((node, expression))
            if len(batch) == BATCH_SIZE or (batch and counts["drawn"] == number):
                wrong += evaluated(batch, judged)
                batch = []
    assert counts["accepted"] > counts["refused"]
    assert not wrong, "\n".join(wrong)


def strictly(node, u, v, found):
    expected = np.ravel(np.asarray(node(u, v), dtype=float))
    for backend, values in found.items():
        if (
            backend == "interpreted"
            and node.name.split("(")[0] in MAXIMA
            and np.isnan([u, v]).any()
        ):
            continue  # blocks/tracing/README.md says so
        if not np.allclose(values, expected, rtol=1e-12, atol=1e-15, equal_nan=True):
            return f"{node} at u = {u}, v = {v}: {backend} {values}, NumPy {expected}"
    return ""


def refused_of(nodes):
    """Return the names of the calls that are refused; all others must be right."""
    found = [(node, traced(node)) for node in nodes]
    wrong = evaluated([(n, e) for n, e in found if e is not None], strictly)
    assert not wrong, "\n".join(wrong)
    return {node.name for node, expression in found if expression is None}


@pytest.mark.filterwarnings("ignore")
def test_single_calls_are_right_at_every_point_or_refused():
    orders = {1: ["u", "v"], 2: ["uv", "vu"], 3: ["uvu"]}
    nodes = [
        Node(n, tuple(map(Node, o)))
        for n, k in ARITY.items()
        if n not in ("dot", "cross")
        for o in orders[k]
    ]
    # the reciprocal is infinite, and 0 * inf NaN
    nodes.append(Node("divide", (Node("u"), Node("5e-324"))))
    with np.errstate(all="ignore"):
        refused = refused_of(nodes)
    without = {"sort", "argmax", "median", "nextafter"}
    assert refused == without | {"max initial"}


@pytest.mark.parametrize("divide", [lambda u: divmod(u, 2.0), lambda u: divmod(2.0, u)])
def test_divmod_names_the_remedy(divide):
    with pytest.raises(
        NeedsNumberError, match=r"divmod\(\) does not trace; write u // v"
    ):
        divide(symbol("u", (2,)))


def test_limits_of_interp_that_are_none_are_those_of_numpy():
    u = symbol("u", (2,))
    assert np.interp(u, [0.0, 1.0], [0.0, 2.0], None, right=None).shape == (2,)


@pytest.mark.parametrize("function", REFUSED_FUNCTIONS, ids=lambda f: f.__name__)
def test_functions_that_casadi_computes_otherwise_are_refused(function):
    count = 2 if function in (np.isclose, np.digitize) else getattr(function, "nin", 1)
    numbers = [symbol("u", (3,))] * count
    with pytest.raises(NeedsNumberError, match=rf"np\.{function.__name__} does not"):
        function(*numbers)


KEYWORDS = {
    "axis": [0, -1],
    "keepdims": [True],
    "initial": [0.5, -9.0, 2.0],
    "where": [np.array([True, False, True])],
    "dtype": [int, bool, np.float32, float],
    "order": ["F", "K"],
    "decimals": [1, -1],
    "period": [1.3],
}


def calls_with_keywords():
    """Return all calls of functions of one or two arrays with one more argument; np.corrcoef is a / a."""
    found = {}
    for name, function in {**vars(np), **vars(np.linalg), "corrcoef": None}.items():
        try:
            parameters = list(inspect.signature(function).parameters.values())
        except (TypeError, ValueError):
            continue
        required = [
            p.name
            for p in parameters
            if p.default is p.empty and p.kind < p.VAR_KEYWORD
        ]
        if (
            not required
            or required[0] not in {*"axm", "arr", "ary", "array", "element"}
            or len(required) > 2
        ):
            continue
        for keyword in {p.name for p in parameters}.intersection(KEYWORDS).difference(
            required
        ):
            for value in KEYWORDS[keyword]:
                extra = (
                    {"initial": 1.0}
                    if keyword == "where" and name in ("max", "min", "amax", "amin")
                    else {}
                )
                text = f"{name}({keyword}={value})"
                found[text] = functools.partial(function, **{keyword: value}, **extra)
                ARITY[text] = len(required)
    return found


@pytest.mark.filterwarnings("ignore")
def test_no_argument_of_a_numpy_function_is_dropped(monkeypatch):
    calls = calls_with_keywords()
    nodes = []
    with np.errstate(all="ignore"):
        for name, function in calls.items():
            monkeypatch.setitem(FUNCTIONS, name, function)
            node = Node(name, tuple(map(Node, "uv"[: ARITY[name]])))
            try:
                if all(np.asarray(node(*p)).dtype.kind in "bif" for p in points()):
                    nodes.append(node)
            except REFUSED_BY_NUMPY:
                continue  # NumPy refuses it as well
        refused = refused_of(nodes)
    assert len(nodes) > 100
    assert {"max(initial=0.5)", "mean(dtype=<class 'int'>)"} <= refused
    assert not {"sum(keepdims=True)", "sum(dtype=<class 'float'>)"} & refused


def test_compilers_do_not_make_numbers_of_nan():
    """Without errno GCC writes sin(atan(x)) as a quotient where |x| is small, else as ±1, also of NaN."""
    v = Node("v")
    outers, inners = (
        ("sin", "cos", "tan", "sinh", "ceil"),
        ("arctan", "arcsin", "arctanh"),
    )
    nodes = [
        Node(outer, (Node(inner, (v,)),))
        for outer, inner in itertools.product(outers, inners)
    ]
    _, compiled = compiled_program(map(traced, nodes), X)
    values = compiled(
        np.concatenate([np.zeros(VECTOR_SIZE), [np.nan, 0.5, np.nan]])
    ).reshape(-1, VECTOR_SIZE)
    for node, found in zip(nodes, values, strict=True):
        assert_array_equal(np.isnan(found), [True, False, True], err_msg=str(node))
