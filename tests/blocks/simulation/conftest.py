"""Fixtures of the tests of simulation."""

import pytest


@pytest.fixture(params=["numpy", "interpreted", "compiled"])
def backend(request):
    """Return each backend in turn."""
    return request.param
