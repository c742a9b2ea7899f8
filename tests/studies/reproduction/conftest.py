"""Fixtures of this folder."""

import pytest
import systems

interpreted = pytest.fixture(scope="module", autouse=True)(systems.interpreted)
