"""Checks shared by the data classes of this package."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import ParameterError
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import finite_array
from trussflow.models.errors import ModelError

# Tolerance of the triangle inequality, relative to the largest principal inertia. Rounded data can be
# exactly on the limit, as those of two links of Table 2.
_TRIANGLE_SLACK = 1e-9

# Tolerance of R^T R from the identity, and of the length of unit vectors.
_ROTATION_SLACK = 1e-9


def frozen_array(what: str, values: Array, shape: tuple[int | None, ...]) -> Vector:
    """Return a read-only float copy of `values` after checking shape and finiteness.

    Parameters
    ----------
    what : str
        Name of the array in messages, for example ``robot arm 'jaco': masses``.
    values : array-like
        Values to check.
    shape : tuple of int or None
        Required shape; None allows any length.

    Returns
    -------
    array

    Raises
    ------
    ModelError
        If the shape differs or an element is not a finite number.
    """
    try:
        array = finite_array(what, values).copy()
    except ParameterError as error:
        raise ModelError(str(error)) from None
    wanted = tuple(
        have if want is None else want
        for want, have in zip(shape, array.shape, strict=False)
    )
    # Unlike parameters of blocks, values are not broadcast: one number for a whole table is an error.
    if len(wanted) != len(shape) or wanted != array.shape:
        sizes = tuple("any" if n is None else n for n in shape)
        raise ModelError(f"{what} has shape {array.shape}; it must be {sizes}")
    array.setflags(write=False)
    return array


def set_fields(frozen: object, **values: object) -> None:
    """Set fields of a frozen dataclass while it is constructed.

    Parameters
    ----------
    frozen : object
        Instance of the dataclass.
    **values
        Values of the fields [any].
    """
    for name, value in values.items():
        object.__setattr__(frozen, name, value)


def check_choice(kind: str, name: object, known: Iterable[object]) -> None:
    """Raise `ModelError` unless a name is among the known ones.

    Parameters
    ----------
    kind : str
        Kind of the named object, for the message.
    name : object
        Name to check.
    known : iterable
        Valid names.

    Raises
    ------
    ModelError
        If the name is not valid; the message lists the valid ones.
    """
    names = list(known)
    if name not in names:
        raise ModelError(
            f"no {kind} {name!r}; choose from: {', '.join(map(str, names))}"
        )


def check_number(owner: str, *, zero: bool = False, **values: Any) -> None:
    """Raise `ModelError` unless all `values` are finite and positive, or zero if allowed.

    Parameters
    ----------
    owner : str
        Owner of the values, for the message.
    zero : bool
        Whether zero is allowed.
    **values : float
        Numbers to check, by name [any].

    Raises
    ------
    ModelError
        If a number is not finite or out of range.
    """
    for name, value in values.items():
        number = frozen_array(f"{owner}: {name}", value, ())
        if number < 0.0 or (number == 0.0 and not zero):
            raise ModelError(
                f"{owner}: {name} is {number:g}; it must be {'at least' if zero else 'above'} 0"
            )


def unit_vectors(what: str, values: npt.ArrayLike) -> Vector:
    """Return a read-only float copy of unit vectors, at least one.

    Parameters
    ----------
    what : str
        Name of a vector in messages.
    values : array_like, shape (m, 3)
        Vectors to check [1].

    Raises
    ------
    ModelError
        If there are no vectors, or a length is not 1.
    """
    vectors = frozen_array(what, values, (None, 3))
    lengths = np.linalg.norm(vectors, axis=1)
    wrong = np.abs(lengths - 1.0)
    if not wrong.size:
        raise ModelError(f"{what}: there are none; give at least one")
    if wrong.max() > _ROTATION_SLACK:
        k = int(wrong.argmax())
        raise ModelError(
            f"{what} {k} has length {lengths[k]:g}; it must be a unit vector"
        )
    return vectors


def central_inertia(mass: float, static_moment: Vector, inertia: Vector) -> Vector:
    """Return the inertia about the centre of mass from that about the origin.

    Parameters
    ----------
    mass : float
        Mass [kg].
    static_moment : array, shape (3,)
        Static moment about the origin [kg·m].
    inertia : array, shape (3, 3)
        Inertia about the origin [kg·m²].

    Returns
    -------
    array, shape (3, 3)
        Inertia about the centre of mass [kg·m²].
    """
    centre = static_moment / mass
    spread: Vector = mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    return inertia - spread


def check_rotation(owner: str, name: str, matrix: Vector) -> None:
    """Raise `ModelError` unless a matrix is a rotation: orthogonal, with determinant +1.

    Parameters
    ----------
    owner, name : str
        Owner and name of the matrix, for the message.
    matrix : array, shape (3, 3)
        Matrix to check [1].

    Raises
    ------
    ModelError
        If the matrix is not a rotation.
    """
    error = float(np.max(np.abs(matrix.T @ matrix - np.eye(3))))
    determinant = np.linalg.det(matrix)
    if error > _ROTATION_SLACK or determinant < 0.0:
        raise ModelError(
            f"{owner}: {name} is not a rotation matrix: R^T R differs from I by {error:.2g}, and the "
            f"determinant is {determinant:.3g} instead of 1"
        )


def check_body(
    owner: str,
    name: str,
    mass: float,
    static_moment: Vector,
    inertia: Vector,
    *,
    thin: bool = False,
) -> None:
    """Raise `ModelError` unless mass, static moment and inertia are physically possible.

    Parameters
    ----------
    owner, name : str
        Owner and name of the body, for the message.
    mass : float
        Mass [kg].
    static_moment : array, shape (3,)
        Static moment about the origin of the body's frame [kg·m].
    inertia : array, shape (3, 3)
        Inertia about the origin of the body's frame [kg·m²].
    thin : bool
        Whether the body may be a thin rod or a point.

    Raises
    ------
    ModelError
        If the mass is not positive or the inertia is not symmetric. Also if the inertia about the centre of
        mass is not positive definite or violates the triangle inequality.
    """
    if not mass > 0.0:
        raise ModelError(f"{owner}: mass of {name} is {mass} kg; it must be positive")
    if not np.allclose(
        inertia, inertia.T, rtol=0.0, atol=1e-12 * np.max(np.abs(inertia))
    ):
        raise ModelError(f"{owner}: inertia of {name} is not symmetric")
    small, middle, large = np.linalg.eigvalsh(
        central_inertia(mass, static_moment, inertia)
    )
    if not (small > 0.0 or (thin and small >= -_TRIANGLE_SLACK * large)):
        raise ModelError(
            f"{owner}: inertia of {name} about its centre of mass is not positive definite: "
            f"its smallest principal value is {small:.4g} kg*m^2"
        )
    if large - small - middle > _TRIANGLE_SLACK * large:
        raise ModelError(
            f"{owner}: no rigid body has the inertia of {name}: its principal values about the "
            f"centre of mass {small:.4g}, {middle:.4g}, {large:.4g} kg*m^2 violate the triangle "
            "inequality; was it given about another point?"
        )
