"""
A converter by successive approximation (PathSim)
=================================================

Eight comparisons, one bit each: the register adds a half, a quarter, an eighth of the range, and keeps
each part that does not exceed the sample. The word is the sample rounded down. PathSim: ``example_sar.py``.
"""

import numpy as np

from trussflow.blocks import (
    Block,
    Diagram,
    Input,
    Output,
    State,
    TimeFunction,
    simulate,
)


class Register(Block):
    """Samples at the first of eight comparisons; -1 to 1 is the range."""

    u, y = Input(), Output()
    sample, word, trial, done = (
        State(),
        State(initial=-1.0),
        State(initial=1.0),
        State(),
    )

    def output(self, t, x, u, p):
        """Return the last complete word."""
        return {"y": x.done}

    def update(self, t, x, u, p):
        """Keep a bit, or not."""
        sample = np.where(x.trial == 1.0, u.u, x.sample)
        word = np.where(x.trial == 1.0, -1.0, x.word)
        word = word + np.where(sample >= word + x.trial, x.trial, 0.0)
        last = x.trial == 2.0**-7
        return {
            "sample": sample,
            "word": word,
            "trial": np.where(last, 1.0, x.trial / 2),
            "done": np.where(last, word, x.done),
        }


bench = Diagram("bench")
source = bench.add(
    source=TimeFunction(lambda t: np.sin(2 * np.pi * t) * np.cos(5 * np.pi * t))
)
register = bench.add(register=Register().sampled(0.02 / 8))
source >> register
result = simulate(bench, 1.0, step=0.02 / 8, log_step=0.02)
exact = np.floor(128 * result["source.y"][:-1].values) / 128
print(
    "words that are wrong:", np.count_nonzero(result["register.y"][1:].values != exact)
)
assert np.array_equal(result["register.y"][1:].values, exact)
