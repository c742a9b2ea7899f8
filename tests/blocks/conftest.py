"""What the tests of blocks share: a cache of compiled code of their own."""

import pytest


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory):
    """Keep compiled code away from the user's cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TRUSSFLOW_CACHE", str(tmp_path_factory.mktemp("compiled")))
        yield
