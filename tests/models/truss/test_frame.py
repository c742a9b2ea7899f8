"""Frames as TOML: reading, handbook beams, and errors."""

import copy
import random
import tomllib
from functools import reduce
from math import pi
from operator import getitem

import campaign
import numpy as np
import pytest
from numpy.testing import assert_allclose
from sources import MISSIONS
from systems import assert_near

from trussflow.models import Frame, ModelError, ParameterTable, reduced_modes

ROUND_OFF = 1e-12
BOOM = MISSIONS / "boom.toml"

TEXT = """
[nodes]
positions = { value = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]], unit = "m", source = "test" }

[materials.steel]
youngs_modulus = { value = 2e11, unit = "Pa", source = "test" }
poissons_ratio = { value = 0.25, unit = "1", source = "test" }
density = { value = 8000.0, unit = "kg/m^3", source = "test" }

[sections.flat]
area = { value = 1e-4, unit = "m^2", source = "test" }
second_moments = { value = [2e-9, 1e-9], unit = "m^4", source = "test" }
torsion_constant = { value = 3e-9, unit = "m^4", source = "test" }

[sections.tube]
diameter = { value = 0.02, unit = "m", source = "test" }
wall = { value = 0.002, unit = "m", source = "test" }

[[members]]
ends = [[1, 2]]
material = "steel"
section = "flat"
elements = 4
across = [0.0, 1.0, 0.0]

[[members]]
ends = [[1, 3]]
material = "steel"
section = "tube"

[[masses]]
nodes = [3]
mass = { value = 2.0, unit = "kg", source = "test" }
inertia = { value = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.5]], unit = "kg*m^2", source = "test" }
"""


def read(folder, text):
    path = folder / "frame.toml"
    path.write_text(text, encoding="utf-8")
    return Frame.from_file(path)


def test_a_cantilever_bends_twists_and_stretches_as_in_the_handbook(tmp_path):
    """l^3 / 3 E I in the plane of `across` and out of it, l / G J, l / E A."""
    structure = read(
        tmp_path, TEXT.replace("nodes = [3]", "nodes = [2, 3]")
    ).structure()
    modes = reduced_modes(structure, 0, [2, 3], clamped=[1])
    shapes = np.concatenate(
        [modes.grasp_translations, modes.grasp_rotations], axis=1
    ).reshape(12, -1)
    found = np.diag(shapes / modes.stiffness @ shapes.T)
    shear = 2e11 / 2.5
    expected = [2.0 / (2e11 * 1e-4), 8.0 / (3 * 2e11 * 2e-9), 8.0 / (3 * 2e11 * 1e-9)]
    expected += [2.0 / (shear * 3e-9), 2.0 / (2e11 * 1e-9), 2.0 / (2e11 * 2e-9)]
    assert_allclose(found[:6], expected, rtol=1e-8)
    tube = pi / 64.0 * (0.02**4 - 0.016**4)
    bent, twisted = 1.0 / (3 * 2e11 * tube), 1.0 / (shear * 2.0 * tube)
    assert_allclose(found[[6, 8, 10]], [bent, bent, twisted], rtol=1e-8)


def test_mass_of_sections_and_bodies(tmp_path):
    structure = read(tmp_path, TEXT).structure()
    tube = pi / 4.0 * (0.02**2 - 0.016**2)
    flat, round_, body = 8000.0 * 1e-4 * 2.0, 8000.0 * tube, 2.0
    assert structure.rigid_mass[0, 0] == pytest.approx(
        flat + round_ + body, rel=ROUND_OFF
    )
    assert_near(
        structure.centre,
        np.array([flat, round_ / 2.0 + body, 0.0]) / (flat + round_ + body),
        ROUND_OFF,
    )
    inertia = flat * 4.0 / 3.0 + round_ / 3.0 + body + 1.5
    assert structure.rigid_mass[5, 5] == pytest.approx(inertia, rel=ROUND_OFF)
    assert structure.source == "frame.toml"


def test_the_boom_of_the_examples():
    boom = reduced_modes(Frame.from_file(BOOM).structure(), 6, [{1, 2, 3}, 14])
    assert (boom.modes, boom.grasps) == (18, 2)
    assert_near(boom.grasp_positions[0], [0.0, 0.0, 0.0], 1e-3)


ERROR_CASES = [
    (
        "[nodes]",
        "[nodes]\nunit = 'm'",
        "frame.toml, nodes: unknown key 'unit'; there are: positions",
    ),
    ("[nodes]", "colour = 'grey'\n[nodes]", "frame.toml: unknown key 'colour'"),
    (
        "density =",
        "Density =",
        r"frame.toml, materials, steel: unknown key 'Density'; there are: youngs_modulus",
    ),
    (
        "wall =",
        "thickness =",
        "frame.toml, sections, tube: unknown key 'thickness'; there are: diameter, wall",
    ),
    ("across =", "along =", r"frame.toml, members\[0\]: unknown key 'along'"),
    ("inertia =", "inertias =", r"frame.toml, masses\[0\]: unknown key 'inertias'"),
    (
        '0.0]], unit = "m"',
        '0.0]], unit = "mm"',
        "'positions' is given in 'mm'; it must be in 'm'",
    ),
    ('unit = "Pa", source = "test"', 'unit = "Pa"', "'youngs_modulus' has no 'source'"),
    (
        "value = 2e11",
        "value = -2e11",
        "materials, steel: youngs_modulus is -2e.11; it must be above 0",
    ),
    (
        "value = 0.25",
        "value = 0.75",
        r"poissons_ratio is 0.75; it must be in \(-1, 0.5\]",
    ),
    ("value = 1e-4", "value = 0.0", "sections, flat: area is 0; it must be above 0"),
    ("[2e-9, 1e-9]", "[2e-9, -1e-9]", "second_moments is -1e-09; it must be above 0"),
    (
        "value = 0.002",
        "value = 0.02",
        "diameter and wall must be above 0, and the wall at most the radius",
    ),
    (
        'material = "steel"',
        'material = "iron"',
        "no material for frame.toml, members.0.: 'iron'; choose from: steel",
    ),
    (
        'section = "tube"',
        'section = "rod"',
        "no section for .*members.1.: 'rod'; choose from: flat, tube",
    ),
    (
        "ends = [[1, 3]]",
        "ends = [[1, 4]]",
        "no node for frame.toml: member 1-4: 4; choose from: 1, 2, 3",
    ),
    ("ends = [[1, 3]]", "ends = [[3, 3]]", "member 3-3 has no length"),
    (
        "ends = [[1, 3]]",
        "ends = [1, 3]",
        r"'ends' must have 2 node numbers each, got \[\[1\], \[3\]\]",
    ),
    ("ends = [[1, 3]]", "", "'ends' is missing; found"),
    (
        "elements = 4",
        "elements = 3",
        "member 1-2 has 3 elements; it must be 1 or an even number",
    ),
    ("elements = 4", "elements = 1002", "it must be 1 or an even number up to 1000"),
    (
        "elements = 4",
        "elements = 4.0",
        "elements is 4.0; hinged must be true or false, elements a whole",
    ),
    ("elements = 4", "elements = 4\nhinged = true", "hinged is True and elements is 4"),
    (
        "across = [0.0, 1.0, 0.0]",
        "",
        "'across' is missing; a section with two different second moments",
    ),
    (
        "across = [0.0, 1.0, 0.0]",
        "across = [1.0, 0.0, 0.0]",
        "'across' is parallel to member 1-2",
    ),
    (
        "[0.0, 1.0, 0.0]], unit",
        "[2.0, 0.0, 0.0]], unit",
        "nodes 2 and 3 are at the same place",
    ),
    (
        "nodes = [3]",
        "nodes = [9]",
        "no node for a mass in frame.toml: 9; choose from: 1, 2, 3",
    ),
    (
        "nodes = [3]",
        "nodes = 3",
        "'nodes' must be a list of whole numbers, or of lists of them, got 3",
    ),
    (
        "value = 2.0, unit",
        "value = -2.0, unit",
        "mass on node 3: mass is -2; it must be above 0",
    ),
    ("0.0, 1.5]]", "0.0, 2.5]]", "no rigid body has the inertia of the mass on node 3"),
]


def test_a_frame_without_members():
    with pytest.raises(
        ModelError, match="frame: there are no members; a frame needs at least one"
    ):
        Frame(positions=np.eye(3), members=())


def test_a_grasp_that_turns_no_mass(tmp_path):
    """The end of a thin rod, twisted."""
    with pytest.raises(
        ModelError, match=r"too little mass; .* give rotational inertia to a node"
    ):
        reduced_modes(read(tmp_path, TEXT).structure(), 0, [2], clamped=[1])


@pytest.mark.parametrize("old, new, message", ERROR_CASES)
def test_errors(tmp_path, old, new, message):
    assert old in TEXT
    with pytest.raises(ModelError, match=message):
        read(tmp_path, TEXT.replace(old, new, 1))


JUNK = (0, -1, 1.5, "x", "", [], [[]], {}, True, np.nan, np.inf, -0.0, [1, 2], [[1, 2]])


def places(content, path=()):
    """Yield the path of everything in a file."""
    if isinstance(content, list):
        content = dict(enumerate(content))
    if isinstance(content, dict):
        for key, value in content.items():
            yield (*path, key)
            yield from places(value, (*path, key))


@pytest.mark.campaign
def test_every_fault_in_a_file_raises_a_model_error(monkeypatch):
    """One entry after the other removed, or replaced: a body, or a ModelError."""
    base, rng, errors = tomllib.loads(TEXT), random.Random(7 + campaign.SEED), 0
    for path in list(places(base)):
        for junk in (None, *rng.sample(JUNK, min(4 * campaign.SIZE, len(JUNK)))):
            content = copy.deepcopy(base)
            owner = reduce(getitem, path[:-1], content)
            if junk is None:
                del owner[path[-1]]
            else:
                owner[path[-1]] = junk
            table = ParameterTable(content, "frame.toml")
            monkeypatch.setattr(ParameterTable, "read", lambda _, table=table: table)
            try:
                reduced_modes(Frame.from_file("frame.toml").structure(), 1, [3])
            except ModelError:
                errors += 1
    assert errors > 200
