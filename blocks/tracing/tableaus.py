"""Coefficients of the methods with variable steps."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache

import numpy as np

from trussflow.blocks.support.interrupts import uninterrupted
from trussflow.blocks.support.types import Vector

METHODS = ("RK45", "DOP853", "Rodas5P")
"""Methods with variable steps, in the order of their numbers in C."""

STIFF_METHOD = "Rodas5P"
"""Method for stiff equations."""

RODAS5P_GAMMA = 0.21193756319429014
"""Diagonal coefficient of Rodas5P [-]."""

RODAS5P_A = """
3.0
2.849394379747939 0.45842242204463923
-6.954028509809101 2.489845061869568 -10.358996098473584
2.8029986275628964 0.5072464736228206 -0.3988312541770524 -0.04721187230404641
-7.502846399306121 2.561846144803919 -11.627539656261098 -0.18268767659942256 0.030198172008377946
"""
"""Coefficients of the points of stages 2 to 6 of Rodas5P [-], one stage in a line."""

RODAS5P_COUPLING = """
-14.155112264123755
-17.97296035885952 -2.859693295451294
147.12150275711716 -1.41221402718213 71.68940251302358
165.43517024871676 -0.4592823456491126 42.90938336958603 -5.961986721573306
24.854864614690072 -3.0009227002832186 47.4931110020768 5.5814197821558125 -0.6610691825249471
30.91273214028599 -3.1208243349937974 77.79954646070892 34.28646028294783 -19.097331116725623 -28.087943162872662
37.80277123390563 -3.2571969029072276 112.26918849496327 66.9347231244047 -40.06618937091002 -54.66780262877968 \
-9.48861652309627
"""
"""Coefficients of the earlier increments in the equations of stages 2 to 8 of Rodas5P [-]."""

RODAS5P_TIMES = """
0.0 0.6358126895828704 0.4095798393397535 0.9769306725060716 0.4288403609558664 1.0 1.0 1.0 1.0
"""
"""Times of the stages of Rodas5P and of the end, in steps [-]."""

RODAS5P_SLOPES = """
0.21193756319429014 -0.42387512638858027 -0.3384627126235924 1.8046452872882734 2.325825639765069 0.0 0.0 0.0
"""
"""Coefficients of the derivative by time in the stages of Rodas5P [-]."""

RODAS5P_DENSE = """
25.948786856663858 -2.5579724845846235 10.433815404888879 -2.3679251022685204 0.524948541321073 \
1.1241088310450404 0.4272876194431874 -0.17202221070155493
-9.91568850695171 -0.9689944594115154 3.0438037242978453 -24.495224566215796 20.176138334709044 \
15.98066361424651 -6.789040303419874 -6.710236069923372
11.419903575922262 2.8879645146136994 72.92137995996029 80.12511834622643 -52.072871366152654 \
-59.78993625266729 -0.15582684282751913 4.883087185713722
"""
"""Coefficients of the dense output of Rodas5P [-]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Tableau:
    """Coefficients of a method with variable steps.

    Attributes
    ----------
    stages : int
        Number of stages s [-].
    a : Vector
        Coefficients of the points of the stages, row by row; row s is the state after the step, and the
        rows after it are those of further stages for dense output [-].
    c : Vector
        Times of these points, in steps [-].
    error : Vector
        Two rows of coefficients of error estimates; the second is zero if there is a single estimate [-].
    dense : Vector
        Rows of coefficients of the dense output [-].
    order : int
        Order in the step of the estimate of the error of one step [-].
    limit : float
        Length of steps at the limit of stability, times the modulus of the eigenvalue [-].
    gamma : float
        Diagonal coefficient of a Rosenbrock method; 0 for an explicit one [-].
    coupling, slope : Vector
        Coefficients of earlier increments and of the derivative by time of a Rosenbrock method [-].
    """

    stages: int
    a: Vector
    c: Vector
    error: Vector
    dense: Vector
    order: int
    limit: float = 0.0
    gamma: float = 0.0
    coupling: Vector = field(default_factory=lambda: np.zeros((1, 1)))
    slope: Vector = field(default_factory=lambda: np.zeros(1))


@cache
def tableau(method: str) -> Tableau:
    """Return the coefficients of one of the `METHODS`.

    RK45 is the pair 5(4) of Dormand and Prince (1980) with the interpolation of Shampine (1986), DOP853 the
    pair 8(5,3) of Hairer, Nørsett and Wanner (1993), which also has the limits of stability. Rodas5P is by
    Steinebach, *BIT Numerical Mathematics* 63:27 (2023).
    """
    if method == STIFF_METHOD:
        return _rodas5p()
    with uninterrupted():
        from scipy import integrate  # takes a third of a second

    # SciPy has the coefficients of the explicit methods.
    found = getattr(integrate, method)
    stages = found.n_stages
    extra = getattr(found, "A_EXTRA", np.zeros((0, stages + 1)))
    a = np.zeros((stages + 1 + len(extra), extra.shape[1]))
    a[:stages, : found.A.shape[1]] = found.A
    a[stages, :stages] = found.B
    a[stages + 1 :] = extra
    if method == "DOP853":
        times, error, dense = found.C_EXTRA, (found.E5, found.E3), found.D
    else:
        # The coefficients of the fourth power determine the quartic: its values and slopes at both
        # ends are those of the step.
        times, error, dense = [], (found.E, 0.0 * found.E), found.P[None, :, 3]
    return Tableau(
        stages=stages,
        a=a,
        c=np.concatenate([found.C, [1.0], times]),
        error=np.array(error),
        dense=np.asarray(dense),
        order=found.error_estimator_order + 1 if method == "RK45" else 8,
        limit=3.25 if method == "RK45" else 6.1,
    )


def _rodas5p() -> Tableau:
    """Return the coefficients of Rodas5P.

    Its last two stages start from the points before plus their increments, and the last increment is the
    error estimate.
    """
    a, coupling = np.zeros((9, 9)), np.zeros((8, 9))
    for text, target in ((RODAS5P_A, a), (RODAS5P_COUPLING, coupling)):
        for i, row in enumerate(_rows(text), 1):
            target[i, : len(row)] = row
    a[6:, :5] = a[5, :5]
    for i in (6, 7, 8):
        a[i, 5:i] = 1.0
    second, third, fourth = np.array(_rows(RODAS5P_DENSE))
    # In powers of the part of the step before and after the time, in turn.
    dense = np.array([second, third + fourth, -fourth])
    return Tableau(
        stages=8,
        a=a,
        c=np.array(_rows(RODAS5P_TIMES)[0]),
        error=np.eye(9)[[7, 8]] * [[1.0], [0.0]],
        dense=np.pad(dense, [(0, 0), (0, 1)]),
        order=5,
        gamma=RODAS5P_GAMMA,
        coupling=coupling,
        slope=np.array(_rows(RODAS5P_SLOPES)[0]),
    )


def _rows(text: str) -> list[list[float]]:
    """Return the numbers in each line of a `text`."""
    return [[*map(float, line.split())] for line in text.strip().splitlines()]
