"""What the tests of blocks share: a cache of compiled code of their own."""

from collections.abc import Iterator

import pytest


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep compiled code away from the user's cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TRUSSFLOW_CACHE", str(tmp_path_factory.mktemp("compiled")))
        yield
