"""Rounding of signals: u - f(u) is exactly zero where f returns u, also where u is a product."""

import numpy as np
import pytest

from trussflow.blocks import (
    DeadZone,
    Diagram,
    Function,
    Gain,
    RateLimiter,
    Saturation,
    Sine,
    ZeroOrderHold,
    simulate,
)

BACKENDS = ("numpy", "interpreted", "compiled")
STEP = 0.01
SHOWN = {
    "saturation": lambda: Saturation(-0.05, 0.05),
    "rate limit": lambda: RateLimiter(10.0, STEP),
    "hold": lambda: ZeroOrderHold(STEP),
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("block", SHOWN)
def test_difference_from_a_block_that_shows_its_input_is_zero(block, backend):
    diagram = Diagram("zero")
    source, product, shown = diagram.add(
        source=Sine(1.0, 3.0), product=Gain(0.1), shown=SHOWN[block]()
    )
    source >> product >> shown
    error = product.y - shown.y
    log = [error, product.y, shown.y]
    result = simulate(diagram, 2.0, step=STEP, backend=backend, log=log, progress=False)
    error, product, shown = (result[port.path].values for port in log)
    assert np.sum(product == shown) > 60
    assert not error[product == shown].any()


@pytest.mark.parametrize("backend", BACKENDS)
def test_zone_of_a_product_is_dead(backend):
    diagram = Diagram("zone")
    source, product, zone = diagram.add(
        source=Sine(1.0, 3.0), product=Gain(0.1), zone=DeadZone(-0.2, 0.2)
    )
    source >> product >> zone
    assert not simulate(diagram, 2.0, step=STEP, backend=backend, progress=False)[
        "zone.y"
    ].any()


@pytest.mark.parametrize("backend", BACKENDS)
def test_product_used_twice_in_an_equation_is_rounded_once(backend):
    def excess(u):
        product = 0.1 * u
        return product - np.clip(product, -0.2, 0.2)

    diagram = Diagram("excess")
    source, law = diagram.add(source=Sine(1.0, 3.0), law=Function(excess))
    source >> law
    assert not simulate(diagram, 2.0, step=STEP, backend=backend, progress=False)[
        "law.y"
    ].any()
