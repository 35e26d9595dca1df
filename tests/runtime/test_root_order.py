"""A drive that factors P in an order of its own: the guards know the factors by state, in C, lanes and NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from runtime.estimator import load

DRIVE, THETA, LANES = "ipmsm_adaptive", 3, 3
REPAIRED, RESTARTED = 0x8, 0x20
U, Y = np.array([10.0, -5.0]), np.array([0.5, 0.2])


def after_a_step(x0: np.ndarray | None, P0: np.ndarray, backend: str, lanes: int) -> tuple[np.ndarray, ...]:
    """x, P, words of P and status, of one lane or the first of several; all lanes are the same."""
    f = load(DRIVE, filter="ckf", backend=backend, dtype="float32")
    x = np.array(f.tuning["x_0"]) if x0 is None else x0
    wide = (slice(None), None) if lanes else (slice(None),)
    f.reset(np.repeat(x[:, None], lanes, axis=1) if lanes else x, P0)
    f.step(U[wide] * np.ones(lanes or 1) if lanes else U, Y[wide] * np.ones(lanes or 1) if lanes else Y)
    taken = (f.x, f.P, f.backend.state()[1], f.status)
    return tuple(np.asarray(value)[..., 0] if lanes else np.asarray(value) for value in taken)


def everywhere(x0: np.ndarray | None, P0: np.ndarray) -> tuple[np.ndarray, ...]:
    first = after_a_step(x0, P0, "c", 0)
    for backend, lanes in (("c", LANES), ("numpy", 0), ("numpy", LANES)):
        for expected, found in zip(first, after_a_step(x0, P0, backend, lanes), strict=True):
            np.testing.assert_array_equal(np.asarray(found), expected, err_msg=f"{backend}, {lanes} lanes")
    return first


def correlated(theta: float) -> np.ndarray:
    """The drive's P_0 with this variance of theta, which every other state shares a little."""
    P0 = np.diag(load(DRIVE, filter="ckf", backend="numpy").tuning["P_0"]).astype(float)
    P0[THETA, THETA] = theta
    share = 0.1 * np.sqrt(np.outer(np.diag(P0), np.diag(P0)))
    P0[THETA, :] += share[THETA, :]
    P0[:, THETA] += share[:, THETA]
    P0[THETA, THETA] = theta
    return P0


@pytest.mark.parametrize(("theta", "status"), [(0.5, 0), (1e3, REPAIRED)])
def test_an_angle_beyond_a_turn_is_given_up(theta: float, status: int) -> None:
    """32 rad^2 / n at most stay of its variance, and P stays positive."""
    _, P, _, found = everywhere(None, correlated(theta))
    assert int(found) == status
    assert P[THETA, THETA] <= 32.0 / 7.0 * 1.1
    assert np.all(np.linalg.eigvalsh(P) > 0)


def test_a_restart_puts_every_variance_in_its_place() -> None:
    filter_ = load(DRIVE, filter="ckf", backend="numpy", dtype="float32")
    x0 = np.array(filter_.tuning["x_0"])
    x0[2] = 1e30
    x, P, _, status = everywhere(x0, correlated(0.01))
    assert int(status) & RESTARTED
    np.testing.assert_array_equal(x, np.float32(filter_.tuning["x_0"]))
    np.testing.assert_array_equal(P, np.diag(np.float32(filter_.tuning["P_0"])).astype(float))
