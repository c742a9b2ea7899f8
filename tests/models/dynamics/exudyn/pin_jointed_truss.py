"""A small pin-jointed truss: nodal masses, modes, and the nodes the robots hold."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, null_space

Array = NDArray[np.float64]

BAYS = 6
LENGTH = 2.2  # of a bay [m]
SIDE = 1.1  # of the square section [m]
BEND = 0.35  # between two bays: the truss is an arc, so that no symmetry hides an error [rad]
TWIST = 0.12  # of the section from one frame to the next [rad]
MASS = 500.0  # [kg]
FIRST_FREQUENCY = 0.12  # low, for a fixed step to resolve every mode [Hz]
DAMPING = 2e-3  # proportional to the stiffness [s]

# The frames held by the robots, and how much each of their four nodes counts.
HELD_FRAMES = (2, 3, 5, 6)
WEIGHTS = np.array([0.1, 0.2, 0.3, 0.4])


@dataclass(frozen=True, slots=True, kw_only=True)
class Truss:
    """A truss reduced to its lowest clamped modes, mass-normalized.

    Attributes
    ----------
    positions : array, shape (n, 3)
        [m].
    masses : array, shape (n,)
        [kg].
    stiffness : array, shape (3 n, 3 n)
        Of the free nodes, node by node [N/m].
    shapes : array, shape (3 n, h)
        Node by node [kg^-½].
    frequencies : array, shape (h,)
        [Hz].
    held : array of int, shape (4, 4)
        Nodes held by each robot.
    """

    positions: Array
    masses: Array
    stiffness: Array
    shapes: Array
    frequencies: Array
    held: NDArray[np.int64]

    def reduced(self, modes, axes=None):
        """Return the truss with its lowest modes, or those in which a held frame turns one way.

        Parameters
        ----------
        modes : int
            How many.
        axes : array, shape (4, 3), optional
            Held frame i may turn about ``axes[i]`` only.
        """
        size = self.stiffness.shape[0]
        allowed = np.eye(size)[:, 12:]
        if axes is not None:
            every = replace(self, shapes=np.eye(size))
            across = [null_space(axis[None]).T for axis in axes]
            refused = np.concatenate(
                [a @ every.grasp(i)[2] for i, a in enumerate(across)]
            )
            allowed = allowed @ null_space(refused @ allowed)
        masses = np.repeat(self.masses, 3)
        squares, vectors = eigh(
            allowed.T @ self.stiffness @ allowed,
            allowed.T @ (masses[:, None] * allowed),
            subset_by_index=(0, modes - 1),
        )
        frequencies = np.sqrt(squares) / (2 * np.pi)
        return replace(self, shapes=allowed @ vectors, frequencies=frequencies)

    def grasp(self, i):
        """Return position, translation and rotation of grasp i per modal coordinate.

        The grasp point is the weighted mean of the held nodes. The rotation is that of the
        rigid motion of these nodes which is nearest to their displacement (least squares).
        """
        nodes = self.held[i]
        centre = WEIGHTS @ self.positions[nodes]
        shapes = self.shapes.reshape(len(self.positions), 3, -1)[nodes]
        translation = np.einsum("n,nia->ia", WEIGHTS, shapes)
        lever = self.positions[nodes] - centre
        root = np.sqrt(WEIGHTS)[:, None, None]
        # u = -lever x rotation: a column of the system per axis of rotation.
        system = -np.cross(lever[:, None, :], np.eye(3)[None]).transpose(0, 2, 1)
        rotation = np.linalg.lstsq(
            (root * system).reshape(-1, 3),
            (root * (shapes - translation)).reshape(12, -1),
        )[0]
        return centre, translation, rotation

    def fields(self):
        """Return what describes the truss to others: the fields of `TrussModes`."""
        centres, translations, rotations = zip(*map(self.grasp, range(4)), strict=True)
        return {
            "positions": self.positions,
            "masses": self.masses,
            "shapes": self.shapes.reshape(len(self.positions), 3, -1),
            "frequencies": self.frequencies,
            "damping_ratios": DAMPING * np.pi * self.frequencies,
            "grasp_positions": np.array(centres),
            "grasp_translations": np.array(translations),
            "grasp_rotations": np.array(rotations),
        }


def truss():
    """Return the truss: frames of four nodes on an arc, the first one clamped."""
    frames, origin, direction = [], np.zeros(3), 0.0
    for k in range(BAYS + 1):
        along = np.array([np.cos(direction), np.sin(direction), 0.0])
        side = np.array([-along[1], along[0], 0.0])
        turn = TWIST * k
        first = np.cos(turn) * side + np.sin(turn) * np.array([0.0, 0.0, 1.0])
        second = np.cross(along, first)
        corners = [(0, 0), (1, 0), (1, 1), (0, 1)]
        frames.append([origin + SIDE * (a * first + b * second) for a, b in corners])
        direction -= BEND
        origin = origin + LENGTH * np.array([np.cos(direction), np.sin(direction), 0.0])
    positions = np.array(frames).reshape(-1, 3)

    bars = []
    for k in range(BAYS + 1):
        bars += [
            (4 * k + a, 4 * k + b) for a, b in ((0, 1), (1, 2), (2, 3), (3, 0), (0, 2))
        ]
        if k < BAYS:
            bars += [(4 * k + c, 4 * k + 4 + c) for c in range(4)]
            bars += [(4 * k + c, 4 * k + 4 + (c + 1) % 4) for c in range(4)]

    stiffness = np.zeros((len(positions), 3, len(positions), 3))
    masses = np.zeros(len(positions))
    for i, j in bars:
        span = positions[j] - positions[i]
        length = float(np.linalg.norm(span))
        block = np.outer(span, span) / length**3
        for a, b, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
            stiffness[a, :, b] += sign * block
        masses[[i, j]] += length / 2
    masses *= MASS / np.sum(masses)

    size = 3 * len(positions)
    whole = Truss(
        positions=positions,
        masses=masses,
        stiffness=stiffness.reshape(size, size),
        shapes=np.zeros((size, 0)),
        frequencies=np.zeros(0),
        held=np.array([[4 * k + c for c in range(4)] for k in HELD_FRAMES]),
    )
    scale = (FIRST_FREQUENCY / whole.reduced(1).frequencies[0]) ** 2
    return replace(whole, stiffness=scale * whole.stiffness)
