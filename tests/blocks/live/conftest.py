"""Live pages in a browser, and runs without fused multiplication and addition to compare with."""

import numpy as np
import pytest
from browsing import Watched

from trussflow.blocks import simulate
from trussflow.blocks.tracing import compiler

UNFUSED = "cc -mno-fma -mno-fma4 -mno-avx512f"


class LivePage(Watched):
    """A live page in a browser."""

    def open(self, place, values=""):
        """Load a file or an address and wait for its first run."""
        address = place if isinstance(place, str) else place.as_uri()
        self.load(f"{address}#{values}")

    def set(self, name, value):
        """Write a value into a number field and wait for the run."""
        before = self.page.evaluate("trussflowLive.run.id")
        field = self.page.get_by_label(f"{name}, number", exact=True)
        field.fill(repr(float(value)))
        field.dispatch_event("change")
        self.wait(f"document.body.dataset.shown > {before}")

    def wait(self, condition):
        """Wait until a condition holds; the page's own policy forbids wait_for_function."""
        met = self.page.evaluate(
            f"async () => {{ for (let i = 0; i < 6000 && !({condition}); ++i)"
            f" await new Promise((r) => setTimeout(r, 5)); return Boolean({condition}); }}"
        )
        assert met, (condition, self.trouble(), self.complaints)

    def rows(self):
        """Return times [s] and logged rows of the latest run."""
        time, log, width = self.page.evaluate(
            "[[...trussflowLive.run.time], [...trussflowLive.run.log], trussflowLive.data.width]"
        )
        return np.array(time), np.array(log).reshape(-1, width)

    def trouble(self):
        """Return the message above the charts."""
        return self.page.locator("#trouble").inner_text()


@pytest.fixture(scope="session")
def window(chromium):
    """Return a page in a browser that any test may use."""
    pytest.importorskip("ziglang")
    context = chromium.new_context(viewport={"width": 1200, "height": 800})
    yield LivePage(context.new_page(), "error", "warning")
    context.close()


@pytest.fixture
def unfused(monkeypatch):
    """Return a function that simulates by C without fused operations, as in WebAssembly."""
    monkeypatch.setenv("CC", UNFUSED)
    compiler.find_compiler.cache_clear()

    def run(diagram, duration, **settings):
        result = simulate(diagram, duration, **settings)
        columns = [
            np.reshape(result[name].values, (result.sizes["time"], -1))
            for name in settings["log"]
        ]
        return result["time"].values, np.hstack(columns)

    yield run
    compiler.find_compiler.cache_clear()
