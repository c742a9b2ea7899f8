"""Settings of the whole suite, and the fixtures of the tests that are about the code itself."""

import os
import signal
import sys
from pathlib import Path

import campaign
import numpy as np
import pytest
from hypothesis import settings

ROOT = Path(__file__).parents[1]

# Kept from run to run: only tests of the cache itself need an empty one.
os.environ.setdefault("TRUSSFLOW_CACHE", str(ROOT / ".compiled"))

# Before any test imports pyplot: no test may open a window.
os.environ.setdefault("MPLBACKEND", "Agg")

# A suite that a shell started in the background ignores Ctrl-C, and so would the commands that tests start.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Neither has a deadline: the first example of a test often compiles a diagram.
settings.register_profile("dev", max_examples=10, derandomize=True, deadline=None)
# The campaign of CI draws the same examples each time; a larger one draws new ones.
settings.register_profile(
    "campaign",
    max_examples=40 * campaign.SIZE,
    derandomize=campaign.SIZE == 1,
    deadline=None,
    print_blob=campaign.SIZE > 1,
)
settings.load_profile("dev")

LONGEST_FIRST = (
    "test_",
    "studies",
    "models",
    "fmu",
    "blocks/sweeps",
    "blocks/simulation",
    "",
)
"""Files and folders in the order in which the workers take them; short files at the end keep all busy."""


LARGE_TOOLS = {"chromium", "ziglang"}
"""Fixtures of tools that other machines lack: a browser, and a compiler that first compiles its own C library."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Sort the tests by file so that the longest files begin first, and leave `LARGE_TOOLS` to the campaign."""
    for item in items:
        if not LARGE_TOOLS.isdisjoint(item.fixturenames):
            item.add_marker(pytest.mark.campaign)

    def place(item):
        path = item.path.relative_to(ROOT / "tests").as_posix()
        return next(
            k for k, prefix in enumerate(LONGEST_FIRST) if path.startswith(prefix)
        )

    items.sort(key=place)


LONG_RUNS = ("models/mean_axes", "models/transport", "test_examples.py")
"""Files and folders whose runs take longer than an optimizing compiler."""


@pytest.fixture(scope="module", autouse=True)
def compiler_options(request):
    """Optimize long runs where `make test` compiles without optimization."""
    place = request.path.relative_to(ROOT / "tests").as_posix()
    with pytest.MonkeyPatch.context() as patch:
        if os.environ.get("TRUSSFLOW_CFLAGS") == "-O0" and place.startswith(LONG_RUNS):
            patch.setenv("TRUSSFLOW_CFLAGS", "-O1")
        yield


@pytest.fixture
def rng():
    return np.random.default_rng(20260215)


@pytest.fixture(scope="session")
def modes():
    """Return the modes of the reconstructed truss."""
    # models are imported by the tests that use them
    from trussflow.models import TrussModes

    return TrussModes.reconstructed()


@pytest.fixture(scope="session")
def ziglang():
    """Skip a test if there is no compiler for other machines and for WebAssembly."""
    pytest.importorskip("ziglang")


@pytest.fixture(scope="session")
def chromium():
    """Return a browser. There is one for all tests of a process, as Playwright runs once in each."""
    from trussflow.models.viewer.still import browser, launch_options

    if browser() is None:
        why = "no Chromium or Chrome is found: apt-get install chromium, or set BROWSER_PATH"
        if os.environ.get("CI") and sys.platform == "linux":
            pytest.fail(why)
        pytest.skip(why)
    driver = pytest.importorskip(
        "playwright.sync_api", reason="needs playwright: the extra 'browser'"
    )
    with driver.sync_playwright() as playwright:
        found = playwright.chromium.launch(
            executable_path=browser(), args=launch_options()
        )
        yield found
        found.close()
