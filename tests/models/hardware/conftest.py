"""Short runs of the hardware: ordinary tests interpret the equations."""

import pytest
import systems

interpreted = pytest.fixture(scope="module", autouse=True)(systems.interpreted)
