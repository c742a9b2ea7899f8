r"""Mean axes and free modes of the system at rest: decoupled coordinates.

The equations of rigid coordinates :math:`x` (pose of the truss frame, joints) and modal coordinates
:math:`\tau` of the clamped truss, linearized at rest, with :math:`G = M_{rr}` and the generalized forces
u and f, are

.. math:: G \ddot x + M_{rf} \ddot\tau = u, \qquad M_{fr} \ddot x + \ddot\tau + \Lambda\tau = f

In the **mean axes** :math:`y = x + G^{-1} M_{rf} \tau`, :math:`G \ddot y = u` holds exactly: their velocity
follows from the momentum of the whole system, which vibrations do not change. The remaining equation,

.. math:: (I - M_{fr} G^{-1} M_{rf}) \ddot\tau + \Lambda\tau = f - M_{fr} G^{-1} u,

has the modes :math:`\tau = \Psi\eta` of the free system, on which the actuators act by B:
:math:`\ddot\eta + \Omega^2\eta = B Q`. The apparent inertia of the mean axes is the same at every frequency,
while that of the truss frame is small above the modes.

References
----------
Canavin, Likins (1977), *Floating reference frames for flexible spacecraft*, for the mean axes of Tisserand;
Meirovitch (1980), *Computational Methods in Structural Dynamics*, for modes of free systems.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from trussflow.blocks.support.types import Vector
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.errors import ModelError


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FreeModes:
    r"""The h lowest modes of the free system at rest, with m rigid coordinates.

    Attributes
    ----------
    inertia : Vector, shape (m, m)
        Inertia of the mean axes, G [kg, kg·m, kg·m²].
    frequencies : Vector, shape (h,)
        Natural frequencies, :math:`\Omega` [rad/s].
    damping_ratios : Vector, shape (h,)
        Damping ratios, without the coupling of the modes [1].
    root_motion : Vector, shape (m, h)
        :math:`S = G^{-1} M_{rf} \Psi`: the rigid coordinates are :math:`x = y - S\eta` [kg^-½, rad/(kg^½·m)].
    influence : Vector, shape (h, actuators)
        B: modal acceleration per unit of each actuator [kg^-½, rad/(kg^½·m)].
    """

    inertia: Vector
    frequencies: Vector
    damping_ratios: Vector
    root_motion: Vector
    influence: Vector

    @classmethod
    def of(cls, dynamics: TrussDynamics, count: int) -> FreeModes:
        """Return the lowest free modes of a system at rest.

        Parameters
        ----------
        dynamics : TrussDynamics
            Truss and robots.
        count : int
            Number of modes, h [-].

        Raises
        ------
        ModelError
            If the system has fewer modes.
        """
        truss, m = dynamics.modes, dynamics.rigid_freedoms
        if not 0 <= count <= truss.modes:
            raise ModelError(
                f"cannot take {count} free modes of a truss of {truss.modes}; choose 0 to {truss.modes}"
            )
        terms = dynamics.evaluate(dynamics.rest)
        mass, actuation = terms.mass_matrix, terms.actuation_matrix
        inertia = mass[:m, :m]
        # Mean axes, the rigid coordinates plus G^-1 M_rf tau, are decoupled from the
        # modes.
        carried = np.linalg.solve(inertia, mass[:m, m:])
        # The Schur complement of G is the modal mass of the truss that moves freely.
        squares, shapes = scipy.linalg.eigh(
            np.diag(truss.stiffness), mass[m:, m:] - mass[m:, :m] @ carried
        )
        shapes = shapes[:, :count]
        frequencies, rates = (
            np.sqrt(squares[:count]),
            4.0 * np.pi * truss.damping_ratios * truss.frequencies,
        )
        return cls(
            inertia=inertia,
            frequencies=frequencies,
            # Only the diagonal of the damping: the coupling of the modes by it is
            # neglected.
            damping_ratios=rates @ shapes**2 / (2.0 * frequencies),
            root_motion=carried @ shapes,
            influence=shapes.T @ (actuation[m:] - carried.T @ actuation[:m]),
        )
