r"""A continuous plant under a sampled controller, linear, and what gains and delays make of the two.

The controller measures every h seconds, and its command acts n samples later; everything in between is exact.
With gains A of actuators,

.. math::
    c_k &= M s_k + N C x_k, \qquad s_{k+1} = K s_k + L C x_k \\
    x_{k+1} &= e^{F h} x_k + G A\, c_{k-n}
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from trussflow.blocks.framework.system import Indices
from trussflow.blocks.linear_analysis.lifting import held_flow
from trussflow.blocks.linear_analysis.references import label_places, plan_labels
from trussflow.blocks.simulation.session import Session
from trussflow.blocks.support.types import Vector

if TYPE_CHECKING:
    import control

DIFFERENCE_STEP = 1e-5
"""Step of central differences, relative to the larger of each state and one [-]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledLoop:
    """Plant and controller of a sampled loop, linearized at one instant of a run.

    Attributes
    ----------
    plant : control.StateSpace
        From command to measurement, continuous, without direct feedthrough.
    controller : control.StateSpace
        From measurement to command, its sign included, discrete: its sample time is that of the loop.
    """

    plant: control.StateSpace
    controller: control.StateSpace

    @classmethod
    def of(
        cls,
        session: Session,
        command: str,
        states: Sequence[str],
        measured: Sequence[str],
    ) -> SampledLoop:
        """Return the loop in a session, linearized where it stands, with what it then commands held.

        The equations are those that the session runs, compiled, and the derivatives central differences
        of them: `Linearizer` is exact, and for plants of 100 states takes seconds where this takes tenths.

        Parameters
        ----------
        session : Session
            Started session of a closed loop with one sample rate, before the samples of its time.
        command : str
            The held output that drives the plant, ``"block.port"``.
        states : sequence of str
            Discrete states of the controller, ``"block.state"``; others stay as they are.
        measured : sequence of str
            Continuous states by which alone the controller knows the plant, ``"block.state[0:3]"``.

        Raises
        ------
        NameLookupError
            If there is no such state.
        SimulationError
            If the session is not started.
        """
        import control  # takes a while to import

        prepared, now = session.prepared, session.save()
        plan, t = prepared.plan, float(now.now)
        labels = plan_labels(plan)
        own = np.concatenate([label_places(labels, name).ravel() for name in states])
        seen = np.concatenate([label_places(labels, name).ravel() for name in measured])
        acting = label_places(labels, command).ravel()
        size = now.x.size
        with contextlib.closing(prepared.open(now.p)) as executor:

            def rates(z: Vector) -> Vector:
                return executor.call("derivative", t, z[:size], z[size:], now.p)

            def sampled(z: Vector) -> Vector:
                d = executor.instant(1, t, z[:size], z[size:].copy(), now.p)
                return np.concatenate([z[:size], d])[[*own, *acting]]

            before = np.concatenate([now.x, now.d])
            after = np.concatenate(
                [now.x, executor.instant(1, t, now.x, now.d.copy(), now.p)]
            )
            flow = _differences(rates, after, [*range(size), *acting])
            jump = _differences(sampled, before, [*own, *seen])
        A, B = flow[:, :size], flow[:, size:]
        plant = control.StateSpace(
            A, B, np.eye(size)[seen], np.zeros((seen.size, acting.size))
        )
        (K, L), (M, N) = (
            np.split(rows, [own.size], axis=1) for rows in np.split(jump, [own.size])
        )
        return cls(
            plant=plant,
            controller=control.StateSpace(
                K, L, M, N, float(plan.system.clocks[0].period)
            ),
        )

    def closed(self, *, actuators: npt.ArrayLike = 1.0, late: int = 0) -> Vector:
        """Return the map of plant, controller and commands under way over one sample time.

        Parameters
        ----------
        actuators : float or array
            Gains, of all or of each [-]; the controller does not know of them.
        late : int
            Delay of the commands in samples, not negative; unknown to the controller [-].
        """
        p, k = self.plant, self.controller
        F, G = held_flow(p.A, p.B, k.dt)
        x, s, m = p.nstates, k.nstates, p.ninputs
        A = np.zeros((x + s + m * late,) * 2)
        A[:x, :x], A[x : x + s, :x], A[x : x + s, x : x + s] = F, k.B @ p.C, k.A
        commands = np.zeros((m * (late + 1), len(A)))  # newest first
        commands[:m, :x], commands[:m, x : x + s] = k.D @ p.C, k.C
        commands[m:, x + s :] = np.eye(m * late)
        A[x + s :] = commands[: m * late]
        A[:x] += G * np.broadcast_to(actuators, m) @ commands[m * late :]
        return A

    def loop_gain(self, where: str) -> control.StateSpace:
        """Return the loop gain with all actuators or all sensors cut, for negative feedback.

        Parameters
        ----------
        where : str
            "actuators" or "sensors".
        """
        import control  # takes a while to import

        p, k = self.plant, self.controller
        F, G = held_flow(p.A, p.B, k.dt)
        sampled = control.StateSpace(F, G, p.C, p.D, k.dt)
        return -(k * sampled if where == "actuators" else sampled * k)

    def continuous_poles(self) -> npt.NDArray[np.complex128]:
        """Return the poles of the closed loop and of its parts, as of continuous systems [1/s]."""
        sampled = np.concatenate(
            [np.linalg.eigvals(M) for M in (self.closed(), self.controller.A)]
        )
        moving = sampled[np.abs(sampled) > 1e-9]
        logs: npt.NDArray[np.complex128] = (
            np.log(moving.astype(complex)) / self.controller.dt
        )
        return np.concatenate([logs, np.linalg.eigvals(self.plant.A)])


def spectral_radius(matrix: Vector) -> float:
    """Return the largest size of an eigenvalue [1].

    Parameters
    ----------
    matrix : Vector, shape (n, n)
        Map over a sample time [as its states]; the loop is stable if the radius is below 1.
    """
    return float(np.abs(np.linalg.eigvals(matrix)).max(initial=0.0))


def _differences(
    function: Callable[[Vector], Vector],
    point: Vector,
    columns: Sequence[int] | Indices,
) -> Vector:
    """Return the derivatives of a function by some elements of a vector."""
    found = []
    for column in columns:
        step = DIFFERENCE_STEP * max(1.0, abs(point[column]))
        ends = []
        for sign in (1.0, -1.0):
            moved = point.copy()
            moved[column] += sign * step
            ends.append(np.array(function(moved)))
        found.append((ends[0] - ends[1]) / (2.0 * step))
    return np.stack(found, axis=-1)
