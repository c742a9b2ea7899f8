"""Data that the tests of the studies share."""

import numpy as np
import pytest

from trussflow.models import TrussModes


@pytest.fixture
def rng():
    return np.random.default_rng(20260215)


@pytest.fixture(scope="session")
def modes():
    return TrussModes.reconstructed()
