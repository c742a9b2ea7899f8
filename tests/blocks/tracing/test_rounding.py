"""Rounding of signals: u - f(u) is exactly zero where f returns u, also where u is a product."""

import campaign
import numpy as np
import pytest
from systems import series

from trussflow.blocks import (
    DeadZone,
    Function,
    Gain,
    RateLimiter,
    Saturation,
    Sine,
    ZeroOrderHold,
    simulate,
)

STEP = 0.01
CHANNEL_COUNT = 50
SHOWN = {
    "saturation": lambda limits: Saturation(-limits, limits),
    "rate limit": lambda limits: RateLimiter(200.0 * limits, STEP),
    "hold": lambda _: ZeroOrderHold(STEP),
}

seeds = pytest.mark.parametrize(
    "seed", [0, *map(campaign.only, campaign.SEED + np.arange(1, 10 * campaign.SIZE))]
)


def products(seed):
    """Return a diagram with random multiples of a sine, and limits that they exceed."""
    gains = np.random.default_rng(seed).uniform(0.1, 2.0, CHANNEL_COUNT)
    diagram = series(source=Sine(np.ones(CHANNEL_COUNT), 3.0), product=Gain(gains))
    return diagram, diagram.product, gains / 2.0


@seeds
@pytest.mark.parametrize("block", SHOWN)
def test_difference_from_a_block_that_shows_its_input_is_zero(block, backend, seed):
    diagram, product, limits = products(seed)
    shown = diagram.add(shown=SHOWN[block](limits))
    product >> shown
    log = [product.y - shown.y, product.y, shown.y]
    result = simulate(diagram, 2.0, step=STEP, backend=backend, log=log)
    error, product, shown = (result[port.path].values for port in log)
    assert np.sum(product == shown) > 60 * CHANNEL_COUNT
    assert not error[product == shown].any()


@seeds
def test_zone_of_a_product_is_dead(backend, seed):
    diagram, product, limits = products(seed)
    zone = diagram.add(zone=DeadZone(-2.0 * limits, 2.0 * limits))
    product >> zone
    assert not simulate(diagram, 2.0, step=STEP, backend=backend)["zone.y"].any()


def test_product_used_twice_in_an_equation_is_rounded_once(backend):
    def excess(u):
        product = 0.1 * u
        return product - np.clip(product, -0.2, 0.2)

    diagram = series(source=Sine(1.0, 3.0), law=Function(excess))
    assert not simulate(diagram, 2.0, step=STEP, backend=backend)["law.y"].any()
