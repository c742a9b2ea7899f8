"""Plant with the data of the truss as parameters."""

from __future__ import annotations

import numpy as np

from trussflow.blocks.framework.declarations import Parameter, Signals
from trussflow.blocks.support.types import Vector
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.errors import ModelError
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.truss.truss_modes import ModalData, TrussModes


class TunableTruss(SpaceTruss):
    """`SpaceTruss` with all data of its truss as parameters: one compiled program simulates any sample.

    The number of modes and the undeformed grasp points are fixed. See `trussflow.models.truss.variations`
    for variations of the truss.

    Parameters
    ----------
    dynamics : TrussDynamics
        Truss and robots; any number of robots, joints and modes.
    modal_actuation : bool
        Whether the actuators do work on the modes (Eq. 42 in full).
    start : Vector, optional
        Coordinates at the start, by default those at rest; see `SpaceTruss` [m, rad, kg^½·m].
    speeds : Vector, optional
        Speeds at the start, by default zero [m/s, rad/s, kg^½·m/s].

    Notes
    -----
    Controllers and replays made from `dynamics` use its nominal truss, not the truss of the run.
    An evaluation reads about 9h² numbers that are constants in a `SpaceTruss`.
    """

    mass = Parameter(unit="kg", above=0.0, meaning="mass of the truss")
    first_moments = Parameter(shape=("shapes", 3), meaning="`ModalData.first_moments`")
    second_moments = Parameter(
        shape=("shapes", "products"), meaning="`ModalData.second_moments`"
    )
    grasp_translations = Parameter(
        shape=("grasp_rows", "modes"), meaning="T, grasp by grasp"
    )
    grasp_rotations = Parameter(
        shape=("grasp_rows", "modes"), meaning="R, grasp by grasp"
    )

    def set_dynamics(self, dynamics: TrussDynamics) -> None:
        """Set also the sizes of the truss data.

        Parameters
        ----------
        dynamics : TrussDynamics
            Truss and robots.
        """
        super().set_dynamics(dynamics)
        self.shapes = self.modes + 1
        self.products = 9 * self.shapes
        self.grasp_rows = 3 * self.robots

    def truss_parameters(self, truss: TrussModes) -> dict[str, Vector]:
        """Return the values of the truss parameters.

        Parameters
        ----------
        truss : TrussModes
            Truss with the same number of modes and the same grasp points.

        Raises
        ------
        ModelError
            If number of modes or grasp points differ.
        """
        own, data = self.dynamics.modes, truss.data
        if truss.modes != own.modes or not np.array_equal(
            truss.grasp_positions, own.grasp_positions
        ):
            raise ModelError(
                f"a truss of {truss.modes} modes with grasp points {truss.grasp_positions.tolist()} m cannot "
                f"replace one of {own.modes} modes with grasp points {own.grasp_positions.tolist()} m; "
                "number of modes and grasp points must be the same"
            )
        return super().truss_parameters(truss) | {
            "mass": np.array(data.mass),
            "first_moments": data.first_moments,
            "second_moments": data.second_moments,
            "grasp_translations": truss.grasp_translations.reshape(-1, truss.modes),
            "grasp_rotations": truss.grasp_rotations.reshape(-1, truss.modes),
        }

    def modal_data(self, p: Signals) -> ModalData:
        """Return the truss data of the equations of motion, from the parameters.

        Parameters
        ----------
        p : Signals
            Parameters of the run.
        """
        spans = [slice(3 * i, 3 * i + 3) for i in range(self.robots)]
        return ModalData(
            p.mass,
            p.first_moments,
            p.second_moments,
            self.dynamics.modes.data.grasp_positions,
            [p.grasp_translations[span] for span in spans],
            [p.grasp_rotations[span] for span in spans],
        )
