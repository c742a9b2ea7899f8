"""Visual shapes of links from a URDF file, for pictures only; the equations of motion do not use them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.errors import Explained
from trussflow.blocks.support.files import destination
from trussflow.blocks.support.types import Vector
from trussflow.models.errors import ModelError
from trussflow.models.robots.urdf_reading import Element, Pose

Triangles = tuple[Vector, NDArray[np.int_]]
"""Corners, shape (k, 3) [m], and the indices of three corners per triangle, shape (m, 3) [-]."""

BOX_CORNERS = np.array([[(k >> axis) & 1 for axis in range(3)] for k in range(8)]) - 0.5
"""Corners of a unit cube [-]."""

BOX_FACES = np.reshape(
    [int(k) for k in "031023457476015054273267062046175137"], (12, 3)
)
"""Triangles of a box, counterclockwise as seen from outside."""

# Number of values in each attribute of a shape; a mesh has defaults.
_SIZES = {
    "box": {"size": 3},
    "cylinder": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
}
_MESH = "mesh"
_AROUND, _ALONG = 16, 8  # corners of round shapes around the axis and along it [-]

# Facet of a binary STL file, little-endian; `more` is its unused attribute count.
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])


class Visual(NamedTuple):
    """One shape in the picture of a robot.

    Attributes
    ----------
    body : int
        Index of the body to which the shape is fixed: 0 is the hand, then the links [-].
    pose : Pose
        Pose in the frame of that body.
    kind : str
        ``"box"``, ``"cylinder"``, ``"sphere"`` or ``"mesh"``; others are not drawn.
    size : array
        Sides of a box; radius and length of a cylinder; radius of a sphere [m]; scales of a mesh [-].
    file : pathlib.Path
        File of a mesh.
    """

    body: int
    pose: Pose
    kind: str
    size: Vector
    file: Path = Path()

    def triangles(self) -> Triangles:
        """Return the triangles of the shape in the frame of its body.

        Raises
        ------
        ModelError
            If the shape cannot be drawn.
        """
        points, faces = self._own()
        return points @ self.pose.rotation.T + self.pose.position, faces

    def _own(self) -> Triangles:
        """Return the triangles in the frame of the shape."""
        if self.kind == "box":
            return BOX_CORNERS * self.size, BOX_FACES
        if self.kind == "cylinder":
            radius, end = self.size[0], self.size[1] / 2.0
            return _revolved(
                np.array([[0.0, -end], [radius, -end], [radius, end], [0.0, end]])
            )
        if self.kind == "sphere":
            angles = np.linspace(0.0, np.pi, _ALONG + 1)
            return _revolved(
                self.size[0] * np.stack([np.sin(angles), -np.cos(angles)], axis=1)
            )
        if self.kind != _MESH:
            raise ModelError(f"a {self.kind}, which is no shape of URDF")
        name, suffix = self.file.name, self.file.suffix.lower()
        if suffix not in _READERS:
            raise ModelError(f"{name}, which is none of {', '.join(_READERS)}")
        with Explained(lambda e: ModelError(f"{name}, which cannot be read: {e}")):
            points, faces = _READERS[suffix](destination(self.file).read_bytes())
            if not (
                np.isfinite(points).all()
                and 0 <= faces.min() <= faces.max() < len(points)
            ):
                raise ValueError("its triangles have invalid corners")
        return points * self.size, faces


def visuals_of(link: Element, folder: Path, body: int, pose: Pose) -> Iterator[Visual]:
    """Yield the shapes of a link.

    Parameters
    ----------
    link : Element
        Link of a URDF file.
    folder : pathlib.Path
        Folder of that file; packages are searched in it and the folders above.
    body : int
        Index of the body of the link [-].
    pose : Pose
        Pose of the link in the frame of that body.

    Raises
    ------
    ModelError
        If a shape has no size.
    """
    for visual in (child for child in link.children if child.tag == "visual"):
        for shape in visual.child("geometry").children:
            sizes = {
                name: shape.numbers(name, n)
                for name, n in _SIZES.get(shape.tag, {}).items()
            }
            size, file = np.concatenate([*sizes.values(), np.zeros(0)]), Path()
            if shape.tag == _MESH:
                file = _located(shape.text("filename"), folder)
                size = shape.numbers("scale", 3, (1.0, 1.0, 1.0))
            yield Visual(body, pose @ visual.origin(), shape.tag, size, file)


def _located(name: str, folder: Path) -> Path:
    """Return the path of a file in a URDF file; packages are folders above it or their parents."""
    scheme, _, rest = name.rpartition("://")
    if scheme not in ("package", "model"):
        return folder / rest
    inside = rest.partition("/")[2]
    # The package is a folder above the file with this name, or itself such a folder.
    places = [up / path for up in (folder, *folder.parents) for path in (rest, inside)]
    return next((place for place in places if os.path.isfile(place)), folder / rest)


def _revolved(profile: Vector) -> Triangles:
    """Return the surface of revolution about z of a profile of radii and heights."""
    angles = 2.0 * np.pi / _AROUND * np.arange(_AROUND)
    rows = [
        np.stack([r * np.cos(angles), r * np.sin(angles), 0.0 * angles + z], axis=1)
        for r, z in profile
    ]
    k, row = np.arange(_AROUND), _AROUND * np.arange(len(profile) - 1)[:, None]
    # Modulo, since the last corner of a ring is joined to its first one.
    low, beside = row + k, row + (k + 1) % _AROUND
    faces = [[low, beside, beside + _AROUND], [low, beside + _AROUND, low + _AROUND]]
    return np.concatenate(rows), np.concatenate(
        [np.stack(each, axis=-1).reshape(-1, 3) for each in faces]
    )


def _stl(raw: bytes) -> Triangles:
    """Return the triangles of an STL file, binary or text."""
    count = int.from_bytes(raw[80:84], "little")
    # The size decides, since binary files may also begin with the word "solid".
    if len(raw) == 84 + _FACET.itemsize * count:
        points = (
            np.frombuffer(raw, _FACET, count, 84)["corners"]
            .reshape(-1, 3)
            .astype(float)
        )
    else:
        words = [line.split() for line in raw.decode().splitlines()]
        points = np.array(
            [line[1:4] for line in words if line[:1] == ["vertex"]], dtype=float
        )
    return points, np.arange(len(points)).reshape(-1, 3)


def _obj(raw: bytes) -> Triangles:
    """Return the triangles of a Wavefront OBJ file; polygons are divided into triangle fans."""
    points, faces = [], []
    for word, *numbers in filter(
        None, map(str.split, raw.decode(errors="replace").splitlines())
    ):
        if word == "v":
            points.append([float(number) for number in numbers[:3]])
        elif word == "f":  # corner/texture/normal; counted from 1, or from -1 backwards
            at = [int(number.partition("/")[0]) for number in numbers]
            at = [k - 1 if k > 0 else len(points) + k for k in at]
            faces += [(at[0], b, c) for b, c in pairwise(at[1:])]
    return np.array(points), np.array(faces)


_READERS = {".stl": _stl, ".obj": _obj}
