"""The truss's terms against sums over its particles, integral by integral."""

import numpy as np
import pytest
from systems import relative_error

from trussflow.models.truss.truss_terms import truss_terms

TOLERANCE = 1e-13  # of the largest element; sums of some hundred products


@pytest.mark.parametrize("deformed", [False, True])
def test_terms_are_the_integrals_of_the_paper(modes, rng, deformed):
    """Eqs. 18 and 19 row by row, with r (published) or r + T tau (exact) as the position."""
    m, shapes = modes.masses, modes.shapes
    tau, rates = rng.standard_normal((2, 6))
    v, w = rng.standard_normal((2, 3))
    deformation = np.concatenate([[1.0], tau]) if deformed else np.ones(1)
    rho = modes.positions + shapes @ tau if deformed else modes.positions
    found = truss_terms(modes.data, deformation, v, w, rates)

    S = m @ rho
    J = sum(
        m_k * (p @ p * np.eye(3) - np.outer(p, p))
        for m_k, p in zip(m, rho, strict=True)
    )
    P = np.einsum("n,nia->ia", m, shapes)
    H = np.einsum("n,nia->ia", m, np.cross(rho[:, :, None], shapes, axis=1))
    swept = np.cross(w, shapes @ rates)
    H_w = m @ np.cross(rho, swept)
    F_w = np.einsum("n,nia,ni->a", m, shapes, swept)
    F_ww = np.einsum("n,nia,ni->a", m, shapes, np.cross(w, np.cross(w, rho)))
    a = np.cross(w, v)
    root_bias = np.concatenate(
        [
            modes.mass * a + np.cross(w, np.cross(w, S)) + 2 * np.cross(w, P @ rates),
            np.cross(S, a) + np.cross(w, J @ w) + 2 * H_w,
        ]
    )
    assert relative_error(found.root[3:, 3:], J) < TOLERANCE
    assert relative_error(found.root[3:, :3] @ v, np.cross(S, v)) < TOLERANCE
    assert relative_error(found.root[:3, 3:] @ w, np.cross(w, S)) < TOLERANCE
    assert relative_error(found.root[:3, :3], modes.mass * np.eye(3)) < TOLERANCE
    assert relative_error(found.coupling, np.concatenate([P, H])) < TOLERANCE
    assert relative_error(found.root_bias, root_bias) < TOLERANCE
    assert relative_error(found.modal_bias, P.T @ a + F_ww + 2 * F_w) < TOLERANCE
