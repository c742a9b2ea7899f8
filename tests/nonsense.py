"""Arguments that make no sense, for the tests of constructors and entry points."""

from fractions import Fraction

import numpy as np

from trussflow.blocks import Gain


class Strange:
    def __repr__(self):
        return "something strange"


NONSENSE = [
    *(
        None,
        True,
        "",
        "x",
        "3",
        "u",
        b"x",
        0,
        -1,
        2,
        3,
        0.0,
        -1.5,
        2.0,
        1e300,
        1e-300,
        np.nan,
        np.inf,
        1j,
    ),
    *(
        10**400,
        10**5000,
        10**9,
        -(10**9),
        2**63,
        Fraction(1, 3),
        [],
        (),
        {},
        set(),
        [[]],
        [None],
        (None,),
    ),
    *(
        [1, [2]],
        [[1, 2], [3]],
        [1.0, np.nan],
        ["a"],
        ["1", "2"],
        [1j],
        [10**400],
        (-1,),
        (2.0,),
        ("3",),
    ),
    *(
        (2, 3),
        [1.0, 2.0],
        [[1.0, 2.0], [3.0, 4.0]],
        [3, 1, 2],
        [0, 0],
        range(3),
        {3: 1},
        {"x": 1},
        {"u": None},
    ),
    *(
        np.zeros(0),
        np.zeros((2, 3)),
        np.zeros((2, 2, 2)),
        np.ones(2, dtype=complex),
        np.array("text"),
    ),
    *(
        np.array([None, 1], dtype=object),
        np.ma.masked_equal([1.0, 2.0], 2.0),
        np.datetime64("2020-01-01"),
    ),
    *(
        object(),
        Strange(),
        int,
        len,
        lambda *a: a,
        iter([1]),
        Gain,
        "foobar",
        "Nm",
        "dB*m",
        "m**s",
        ("m", 3),
    ),
]
