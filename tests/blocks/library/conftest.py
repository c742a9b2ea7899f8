"""Small diagrams run interpreted: compiling them takes longer."""

import pytest
import systems

interpreted = pytest.fixture(scope="module", autouse=True)(systems.interpreted)
