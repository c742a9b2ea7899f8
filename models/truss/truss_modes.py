"""Modal data of a flexible truss: point masses, their mode shapes, and the grasp points."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trussflow.blocks.support.files import reading, replaced
from trussflow.blocks.support.types import Array, Vector
from trussflow.models.errors import ModelError
from trussflow.models.parameter_files import shipped_file
from trussflow.models.validation import central_inertia, frozen_array, set_fields


class ModalData(NamedTuple):
    r"""Truss data of the equations of motion: numbers, or expressions of a traced block.

    Attributes
    ----------
    mass : float
        Mass [kg].
    first_moments : array, shape (h + 1, 3)
        `TrussModes.first_moments`.
    second_moments : array, shape (h + 1, 9 h + 9)
        `TrussModes.second_moments`, with the flattened 3 x 3 blocks of a row side by side.
    grasp_positions : sequence of array, shape (3,)
        Undeformed grasp points [m].
    grasp_translations : sequence of array, shape (3, h)
        :math:`T` at the grasp points [kg^-½].
    grasp_rotations : sequence of array, shape (3, h)
        :math:`R` at the grasp points [rad/(kg^½·m)].
    """

    mass: Array
    first_moments: Array
    second_moments: Array
    grasp_positions: Sequence[Array]
    grasp_translations: Sequence[Array]
    grasp_rotations: Sequence[Array]


LINEAR_LIMIT = 0.1
"""Limit of validity of linear shapes: displacements relative to the size [-], rotations [rad].

If the end of a cantilever is displaced by a tenth of its length, linear theory gives 1 % too much, and omits
the foreshortening of 0.6 % of the length. Bisshopp, Drucker (1945), *Large deflection of cantilever beams*,
Quarterly of Applied Mathematics 3(3).
"""

FILE_FORMAT = "trussflow truss modes 1"
"""Value of the key ``format`` in files of modal data."""

FILE_KEYS = {
    "source": "source",
    "position_m": "positions",
    "mass_kg": "masses",
    "shape_per_sqrt_kg": "shapes",
    "frequency_hz": "frequencies",
    "damping_ratio": "damping_ratios",
    "grasp_position_m": "grasp_positions",
    "grasp_translation_per_sqrt_kg": "grasp_translations",
    "grasp_rotation_rad_per_sqrt_kg_m": "grasp_rotations",
}
"""Attributes in files of modal data, by key."""

# Tolerance of E = sum m T^T T from the identity, which the equations assume.
_ORTHONORMALITY = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrussModes:
    r"""Truss reduced to h modes, clamped at its frame :math:`O_t`.

    The elastic displacement of a point is :math:`T \tau`, its elastic rotation
    :math:`R \tau`, with modal coordinates :math:`\tau` in kg^½·m. All mass is in points, so
    that integrals over the truss are sums. All components are in the axes of :math:`O_t`.

    Attributes
    ----------
    positions : array, shape (n, 3)
        Undeformed positions of the point masses [m].
    masses : array, shape (n,)
        Point masses [kg].
    shapes : array, shape (n, 3, h)
        :math:`T` at the point masses, mass-normalized [kg^-½].
    frequencies : array, shape (h,)
        Natural frequencies [Hz].
    damping_ratios : array, shape (h,)
        Damping ratios [1].
    grasp_positions : array, shape (k, 3)
        Undeformed grasp points [m].
    grasp_translations : array, shape (k, 3, h)
        :math:`T` at the grasp points [kg^-½].
    grasp_rotations : array, shape (k, 3, h)
        :math:`R` at the grasp points [rad/(kg^½·m)].
    source : str
        Origin of the data.
    first_moments : array, shape (h + 1, 3)
        Derived: :math:`\int T_a\,dm` with :math:`T_0 = r`; row 0 is S, the others are the columns of P.
    second_moments : array, shape (h + 1, h + 1, 3, 3)
        Derived: :math:`\int T_a T_b^T\,dm` with :math:`T_0 = r`. All integrals of Eq. 19, without or
        with the elastic displacement, are combinations of these.

    Raises
    ------
    ModelError
        If a shape is wrong, a number is not finite, a mass is negative, the points are on one line,
        a frequency is not positive, or the modes are not orthonormal.

    References
    ----------
    Li, Wei, Chen (2026), Eqs. 9 and 19.
    """

    positions: Vector
    masses: Vector
    shapes: Vector
    frequencies: Vector
    damping_ratios: Vector
    grasp_positions: Vector
    grasp_translations: Vector
    grasp_rotations: Vector
    source: str
    first_moments: Vector = field(init=False, repr=False)
    second_moments: Vector = field(init=False, repr=False)

    def __post_init__(self) -> None:
        # A number in place of an array is refused below, with the name of the field.
        points, modes, grasps = (
            len(a) if hasattr(a, "__len__") else 1
            for a in (self.masses, self.frequencies, self.grasp_positions)
        )
        expected = {
            "positions": (points, 3),
            "masses": (points,),
            "shapes": (points, 3, modes),
            "frequencies": (modes,),
            "damping_ratios": (modes,),
            "grasp_positions": (grasps, 3),
            "grasp_translations": (grasps, 3, modes),
            "grasp_rotations": (grasps, 3, modes),
        }
        for name, shape in expected.items():
            array = frozen_array(f"truss modes: {name}", getattr(self, name), shape)
            set_fields(self, **{name: array})
        # With T_0 = r one product gives all integrals of Eq. 19, also for a deformed
        # truss.
        all_shapes = np.concatenate([self.positions[:, :, None], self.shapes], axis=2)
        first = np.einsum("n,nia->ai", self.masses, all_shapes)
        second = np.einsum(
            "n,nia,njb->abij", self.masses, all_shapes, all_shapes, optimize=True
        )
        set_fields(self, first_moments=first, second_moments=second)
        self._check()

    def _check(self) -> None:
        for name, unit, wrong, rule in (
            ("masses", " kg", self.masses < 0.0, "none may be negative"),
            ("frequencies", " Hz", self.frequencies <= 0.0, "it must be positive"),
            ("damping_ratios", "", self.damping_ratios < 0.0, "none may be negative"),
        ):
            if np.any(wrong):
                i = int(np.argmax(wrong))
                raise ModelError(
                    f"truss modes: {name}[{i}] is {getattr(self, name)[i]}{unit}; {rule}"
                )
        if not self.mass > 0.0:
            raise ModelError("truss modes: the total mass is zero; it must be positive")
        central = central_inertia(self.mass, self.static_moment, self.inertia)
        smallest, _, largest = np.linalg.eigvalsh(central)
        # For points on a line the smallest value is round-off of either sign.
        if not smallest > 1e-12 * largest:
            raise ModelError(
                "truss modes: the point masses lie on one line; their inertia about the centroid "
                f"must be positive definite, its smallest principal value is {smallest:.3g} kg*m^2"
            )
        error = np.abs(self.modal_mass - np.eye(self.modes))
        if np.any(error > _ORTHONORMALITY):
            a, b = (int(i) for i in np.unravel_index(np.argmax(error), error.shape))
            raise ModelError(
                f"truss modes: the mode shapes are not mass-normalized and orthogonal: "
                f"sum m T^T T is {self.modal_mass[a, b]:.6g} at modes ({a + 1}, {b + 1}), "
                f"it must be {float(a == b):.0f} within {_ORTHONORMALITY:g}"
            )

    @property
    def modes(self) -> int:
        """Number of modes, h."""
        return len(self.frequencies)

    @property
    def grasps(self) -> int:
        """Number of grasp points, k."""
        return len(self.grasp_positions)

    @property
    def data(self) -> ModalData:
        """Truss data of the equations of motion."""
        return ModalData(
            self.mass,
            self.first_moments,
            self.second_moments.reshape(self.modes + 1, -1),
            tuple(self.grasp_positions),
            tuple(self.grasp_translations),
            tuple(self.grasp_rotations),
        )

    @property
    def mass(self) -> float:
        """Mass of the truss [kg]."""
        return float(np.sum(self.masses))

    @property
    def static_moment(self) -> Vector:
        r""":math:`S_t = \int r\,dm` [kg·m], shape (3,) (Li, Wei, Chen 2026, Eq. 19)."""
        return np.asarray(self.first_moments[0])

    @property
    def inertia(self) -> Vector:
        r""":math:`J_t = \int (r^T r I - r r^T)\,dm` [kg·m²], shape (3, 3) (Eq. 19)."""
        spread = self.second_moments[0, 0]
        return np.asarray(np.trace(spread) * np.eye(3) - spread)

    @property
    def momentum_coefficients(self) -> Vector:
        r""":math:`P_t = \int T\,dm` [kg^½], shape (3, h) (Eq. 19)."""
        return np.asarray(self.first_moments[1:].T)

    @property
    def modal_mass(self) -> Vector:
        r""":math:`E_t = \int T^T T\,dm` [1], shape (h, h), the identity (Eq. 19)."""
        return np.asarray(np.trace(self.second_moments[1:, 1:], axis1=2, axis2=3))

    @property
    def stiffness(self) -> Vector:
        r"""Diagonal of :math:`\Lambda_t`, :math:`(2 \pi f)^2` [1/s²], shape (h,) (Eq. 28)."""
        return (2.0 * np.pi * self.frequencies) ** 2

    def deflection(self, modal: Vector) -> float:
        """Return the greatest displacement of a point over the truss's size, or rotation of a grasp [-, rad].

        Above `LINEAR_LIMIT` linear shapes are not valid.

        Parameters
        ----------
        modal : array, shape (instants, h)
            Modal coordinates [kg^½·m].
        """
        size = np.linalg.norm(np.ptp(self.positions, axis=0))
        shares = (*(self.shapes / size), *self.grasp_rotations)
        return max(
            float(np.max(np.linalg.norm(modal @ share.T, axis=1), initial=0.0))
            for share in shares
        )

    def truncated(self, modes: int) -> TrussModes:
        """Return the same truss with its first modes only.

        Parameters
        ----------
        modes : int
            Number of modes, from 0 (rigid) to h [-].

        Returns
        -------
        TrussModes

        Raises
        ------
        ModelError
            If the truss has fewer modes.
        """
        if modes not in range(self.modes + 1):
            raise ModelError(
                f"cannot keep {modes} modes of {self.modes}; choose 0 to {self.modes}"
            )
        return self.reshaped(
            lambda shapes: shapes[..., :modes],
            frequencies=self.frequencies[:modes],
            damping_ratios=self.damping_ratios[:modes],
        )

    def reshaped(self, change: Callable[[Vector], Vector], **others: Any) -> TrussModes:
        """Return the same truss with changed shapes at the point masses and grasp points.

        Parameters
        ----------
        change : callable
            Function of shapes, modes along the last axis, that returns the changed ones.
        **others
            Other attributes that change [units of the attributes].
        """
        names = ("shapes", "grasp_translations", "grasp_rotations")
        changed: dict[str, Any] = {name: change(getattr(self, name)) for name in names}
        return replace(self, **changed, **others)

    def damped(self, ratio: float) -> TrussModes:
        """Return the same truss with one damping ratio in every mode.

        Parameters
        ----------
        ratio : float
            Damping ratio [1].

        Returns
        -------
        TrussModes

        Raises
        ------
        ModelError
            If `ratio` is negative or not finite.
        """
        return replace(self, damping_ratios=np.full(self.modes, ratio))

    @classmethod
    def reconstructed(cls) -> TrussModes:
        """Return the paper's truss from the data file of the package: six modes, undamped.

        Its shapes are those of the finite-element model (`trussflow.models.truss.paper_truss`) by Pynite, its
        frequencies and grasp points those of Tables 1 and 2 of the paper.
        """
        return cls.load(shipped_file("truss_modes.json"))

    @classmethod
    def load(cls, path: str | Path) -> TrussModes:
        """Read modal data from a JSON file, with one key per array and units in the keys.

        ================================ ========= =====================================================
        key                              shape     meaning
        ================================ ========= =====================================================
        format                           text      always ``"trussflow truss modes 1"``
        source                           text      origin of the data
        position_m                       (n, 3)    point masses, undeformed, in the truss frame
        mass_kg                          (n,)      masses of these points
        shape_per_sqrt_kg                (n, 3, h) mass-normalized mode shapes at these points
        frequency_hz                     (h,)      natural frequencies
        damping_ratio                    (h,)      damping ratios
        grasp_position_m                 (k, 3)    grasp points, undeformed
        grasp_translation_per_sqrt_kg    (k, 3, h) mode shapes at the grasp points
        grasp_rotation_rad_per_sqrt_kg_m (k, 3, h) rotations of the modes at the grasp points
        ================================ ========= =====================================================

        Parameters
        ----------
        path : str or pathlib.Path
            JSON file.

        Returns
        -------
        TrussModes

        Raises
        ------
        ModelError
            If the file cannot be read, its keys are not those above, or its data are invalid.
        """
        cannot = "cannot read truss modes from"
        with reading(path, ModelError, cannot, "it is not JSON ({})") as file:
            content = json.loads(file.read_text(encoding="utf-8"))
        problem = f"{cannot} '{path}'"
        if not isinstance(content, dict) or content.pop("format", None) != FILE_FORMAT:
            raise ModelError(
                f"{problem}: it must be an object with 'format': {FILE_FORMAT!r}"
            )
        for kind, keys in (
            ("unknown", content.keys() - FILE_KEYS),
            ("missing", FILE_KEYS.keys() - content),
        ):
            if keys:
                raise ModelError(f"{problem}: {kind} keys {sorted(keys)}")
        try:
            return cls(**{name: content[key] for key, name in FILE_KEYS.items()})
        except ModelError as error:
            raise ModelError(
                f"cannot use the data in {str(path)!r}: {error}"
            ) from error

    def save(self, path: str | Path) -> None:
        """Write the modal data to a file; `load` returns exactly the same data.

        Parameters
        ----------
        path : str or pathlib.Path
            File to write; an existing one is replaced.
        """
        values = {key: getattr(self, name) for key, name in FILE_KEYS.items()}
        lines = [
            f"{json.dumps(key)}: {json.dumps(value, default=np.ndarray.tolist, separators=(',', ':'))}"
            for key, value in {"format": FILE_FORMAT, **values}.items()
        ]
        with replaced(path) as partial:
            partial.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def axial(matrix: Array) -> Array:
    r"""Return :math:`\int a \times b\,dm` from :math:`\int a b^T dm`.

    Parameters
    ----------
    matrix : array, shape (3, 3)
        Second moment of two vector fields.

    Returns
    -------
    array, shape (3,)
        Integral of their cross product, in the same unit.
    """
    return np.stack(
        [
            matrix[1, 2] - matrix[2, 1],
            matrix[2, 0] - matrix[0, 2],
            matrix[0, 1] - matrix[1, 0],
        ]
    )
