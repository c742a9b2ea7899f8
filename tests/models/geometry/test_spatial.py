"""Spatial algebra against clouds of particles."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import assert_near

from trussflow.models.geometry.rotation import fixed_rotation
from trussflow.models.geometry.spatial import (
    SpatialInertia,
    combined,
    force_product,
    inertia_matrix,
    inertial_force,
    momentum,
    motion_product,
    moved_inertia,
)

ROUND_OFF = 1e-13


def cloud_inertia(masses, places):
    inertia = sum(
        m * (p @ p * np.eye(3) - np.outer(p, p))
        for m, p in zip(masses, places, strict=True)
    )
    return SpatialInertia(float(masses.sum()), masses @ places, np.asarray(inertia))


def off(one, two):
    return max(
        float(np.max(np.abs(np.subtract(a, b)))) for a, b in zip(one, two, strict=True)
    )


@pytest.fixture
def cloud(rng):
    return rng.uniform(0.5, 1.0, 6), rng.standard_normal((6, 3))


def test_moved_inertia_is_that_of_the_moved_particles(cloud, rng):
    masses, places = cloud
    rotation, position = fixed_rotation(rng.uniform(-3, 3, 3)), rng.standard_normal(3)
    moved = moved_inertia(cloud_inertia(masses, places), rotation, position)
    assert off(moved, cloud_inertia(masses, position + places @ rotation.T)) < ROUND_OFF
    assert_array_equal(moved.inertia, moved.inertia.T)


def test_combined_inertia_is_that_of_all_particles(cloud):
    masses, places = cloud
    parts = [cloud_inertia(masses[s], places[s]) for s in (slice(0, 2), slice(2, 6))]
    assert off(combined(*parts), cloud_inertia(masses, places)) < ROUND_OFF


def test_momentum_is_the_sum_over_particles(cloud, rng):
    masses, places = cloud
    motion = rng.standard_normal(6)
    velocities = motion[:3] + np.cross(motion[3:], places)
    expected = np.concatenate(
        [masses @ velocities, masses @ np.cross(places, velocities)]
    )
    body = cloud_inertia(masses, places)
    assert_near(momentum(body, motion), expected, ROUND_OFF)
    assert_near(inertia_matrix(body) @ motion, expected, ROUND_OFF)


def test_inertial_force_is_the_sum_over_particles(cloud, rng):
    """A particle at p accelerates with (a + w × v) + w' × p + w × (w × p)."""
    masses, places = cloud
    velocity, acceleration = rng.standard_normal((2, 6))
    v, w = velocity[:3], velocity[3:]
    particle = (
        acceleration[:3]
        + np.cross(w, v)
        + np.cross(acceleration[3:], places)
        + np.cross(w, np.cross(w, places))
    )
    expected = np.concatenate([masses @ particle, masses @ np.cross(places, particle)])
    found = inertial_force(cloud_inertia(masses, places), velocity, acceleration)
    assert_near(found, expected, ROUND_OFF)


def test_products_leave_power_unchanged(rng):
    """Moving a motion and a force together does not change their power: the two are dual."""
    velocity, motion, force = rng.standard_normal((3, 6))
    change = motion_product(velocity, motion) @ force + motion @ force_product(
        velocity, force
    )
    assert abs(change) < ROUND_OFF
