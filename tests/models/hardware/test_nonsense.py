"""Nonsense arguments of the constructors of hardware raise one of the package's errors."""

import inspect
import random
from collections import Counter

import campaign
import numpy as np
import pytest
from nonsense import NONSENSE

from trussflow.blocks.errors import TrussflowError
from trussflow.models import (
    JointDrives,
    Measurement,
    Pulses,
    ReactionWheels,
    ThrusterSet,
)

ORDINARY = [
    0.1,
    0.02,
    0.3,
    1,
    2,
    6,
    70.0,
    1.0,
    (2, 3),
    np.eye(3),
    np.concatenate([np.eye(3), -np.eye(3)]),
]


def axial(maximum, period, specific_impulse, quantum):
    law = {"maximum": maximum, "period": period, "specific_impulse": specific_impulse}
    return ThrusterSet.axial(quantum=quantum, **law)


def pulsed(maximum, tick, minimum_impulse=0.0, on_delay=0.0, off_delay=0.0):
    law = {
        "maximum": maximum,
        "period": 0.1,
        "specific_impulse": 70.0,
        "minimum_impulse": minimum_impulse,
    }
    return ThrusterSet.pairs(
        0.3, tick=tick, on_delay=on_delay, off_delay=off_delay, **law
    )


def sensor(shape, seed, initial_value=0.0, delay=0.0):
    law = Measurement(
        sample_time=0.1, noise=1.0, random_walk=1.0, quantum=0.1, delay=delay
    )
    return law.sensor(shape, seed=seed, initial_value=initial_value)


ENTRY_POINTS = (
    *(ThrusterSet, Pulses, ReactionWheels, JointDrives, Measurement),
    *(axial, pulsed, sensor),
)


def call(function, rng):
    """Call a function with nonsense; return the kind of result. Other errors than the package's pass on."""
    arguments = {
        name: rng.choice(NONSENSE if rng.random() < 0.4 else ORDINARY)
        for name, parameter in inspect.signature(function).parameters.items()
        if parameter.default is parameter.empty or rng.random() < 0.3
    }
    try:
        function(**arguments)
    except TrussflowError as error:
        return type(error).__name__
    return "accepted"


@pytest.mark.campaign
def test_nonsense_raises_errors_of_the_package():
    results = Counter()
    for number in range(300 * campaign.SIZE):
        rng = random.Random(f"{campaign.SEED} {number}")
        results[call(rng.choice(ENTRY_POINTS), rng)] += 1
    assert 0 < results["accepted"] < results.total()
