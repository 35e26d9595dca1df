"""L D L^T: factoring and measuring in it, against dense Kalman algebra in NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from codegen.fast.factored import ScalarUpdates, decorrelated, factor, from_packed, to_packed
from codegen.ir.expr import Expr
from codegen.ir.graph import Graph
from tests.codegen.graphs import FLOAT, evaluate

pytestmark = pytest.mark.unit

Array = np.ndarray


class Sheet:
    """Numbers as graph inputs, and results back as numbers."""

    def __init__(self) -> None:
        self.graph, self.point = Graph(), dict[str, float]()

    def put(self, value: Any) -> Any:
        """The same nesting of lists, numbers replaced; 0 becomes a structural zero."""
        if np.ndim(value):
            return [self.put(item) for item in value]
        if value == 0.0:
            return Expr(self.graph, self.graph.const(0.0))
        name = f"v{len(self.point)}"
        self.point[name] = float(value)
        return Expr(self.graph, self.graph.input(name))

    def get(self, value: Any) -> Any:
        if isinstance(value, list):
            return np.array([self.get(item) for item in value])
        return evaluate(self.graph, [value.node], self.point, FLOAT)[value.node]


def covariance(rng: np.random.Generator, n: int) -> Array:
    A = rng.normal(size=(n, n))
    scale = 10.0 ** rng.uniform(-2, 2, n)
    return np.asarray((A @ A.T + 0.1 * np.eye(n)) * np.outer(scale, scale))


def close(found: Array, expected: Array, P: Array) -> None:
    """Entries of a covariance on the scale of their sigmas: 1e-10, a few hundred roundings at these conditions."""
    sigma = np.sqrt(np.diag(P))
    assert np.max(np.abs(found - expected) / np.outer(sigma, sigma)) <= 1e-10


def dense(L: Array, D: Array) -> Array:
    return np.asarray(L @ np.diag(D) @ L.T)


@pytest.mark.parametrize("n", range(1, 7))
def test_factor_is_cholesky_without_roots(n: int) -> None:
    """In any order of the states: P is L D L^T as it stands, and L's rows are triangular in that order."""
    rng = np.random.default_rng(n)
    for order in (np.arange(n), *(rng.permutation(n) for _ in range(4))):
        P, sheet = covariance(rng, n), Sheet()
        lower = np.tril(P) + np.triu(np.full((n, n), 9.9), 1)
        L, D, _ = factor(sheet.put(lower), sheet.put(np.full(n, 1e-30)), list(order))
        found_L, found_D = sheet.get(L), sheet.get(D)
        close(dense(found_L, found_D), P, P)
        root = np.linalg.cholesky(P[np.ix_(order, order)])
        np.testing.assert_allclose(found_D, np.diag(root) ** 2, rtol=1e-9)
        assert np.all(np.diag(found_L[order]) == 1.0)
        assert np.all(np.triu(found_L[order], 1) == 0.0)


def test_the_floor_holds_and_is_idle_above_it() -> None:
    """P = A + diag(floor), A positive semidefinite of rank 2: no pivot is below its floor; of a singular P it is."""
    rng = np.random.default_rng(1)
    for n in (2, 3, 5):
        A, floor = rng.normal(size=(n, 2)), rng.uniform(0.1, 1.0, n)
        P, sheet = A @ A.T + np.diag(floor), Sheet()
        L, D, _ = factor(sheet.put(P), sheet.put(floor), range(n))
        found = sheet.get(D)
        assert np.all(found >= floor)
        close(dense(sheet.get(L), found), P, P)
        singular = Sheet()
        _, D, _ = factor(singular.put(np.ones((n, n))), singular.put(floor), range(n))
        np.testing.assert_array_equal(singular.get(D)[1:], np.maximum(floor[1:], 0.0))


@pytest.mark.parametrize("n", [1, 2, 5])
def test_packing_there_and_back(n: int) -> None:
    sheet = Sheet()
    words = sheet.put(np.arange(1.0, n * (n + 1) // 2 + 1))
    for order in (range(n), [*reversed(range(n))]):
        assert to_packed(*from_packed(words, order), order) == words


def kalman(P: Array, x: Array, H: Array, R: Array, nu: Array) -> tuple[Array, Array, Array]:
    """x, P (Joseph's form) and Pyy of a linear measurement with innovation nu."""
    Pyy = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(Pyy)
    left = np.eye(len(x)) - K @ H
    return x + K @ nu, left @ P @ left.T + K @ R @ K.T, Pyy


def measured(sheet: Sheet, P: Array, x: Array, H: Array, nu: Array, variances: list[Any] | Array) -> ScalarUpdates:
    root = np.linalg.cholesky(P)
    L, D = root / np.diag(root), np.diag(root) ** 2
    unit = [
        [sheet.put(0.0) + float(i == j) if i <= j else sheet.put(L[i, j]) for j in range(len(x))] for i in range(len(x))
    ]
    values = sheet.put(variances) if isinstance(variances, np.ndarray) else variances
    return ScalarUpdates(unit, sheet.put(D), sheet.put(x), sheet.put(H @ L), sheet.put(nu), values)


@pytest.mark.parametrize("m", [1, 2, 3])
@pytest.mark.parametrize("n", [1, 2, 4, 6])
def test_measurements_one_after_another_are_the_joint_one(n: int, m: int) -> None:
    """Independent noise; x, P and the product of the spans, which is det Pyy."""
    rng = np.random.default_rng(10 * n + m)
    P, x = covariance(rng, n), rng.normal(size=n)
    H, nu, R = rng.normal(size=(m, n)), rng.normal(size=m), np.diag(rng.uniform(0.1, 2.0, m))
    sheet = Sheet()
    state = measured(sheet, P, x, H, nu, np.diag(R))
    for _ in range(m):
        state.take()
    x_new, P_new, Pyy = kalman(P, x, H, R, nu)
    close(dense(sheet.get(state.L), sheet.get(state.D)), P_new, P)
    assert np.max(np.abs(sheet.get(state.correction) - x_new) / np.sqrt(np.diag(P))) <= 1e-9
    assert np.prod(sheet.get(state.innovation_variances)) == pytest.approx(np.linalg.det(Pyy), rel=1e-9)
    assert np.all(sheet.get(state.D) > 0)
    assert np.all(np.diag(sheet.get(state.L)) == 1.0)


def test_columns_that_a_measurement_does_not_see_stay() -> None:
    """y = x_0: with L unit lower triangular only the first column is seen; D_1, D_2 and L_21 are the same nodes."""
    rng = np.random.default_rng(3)
    P, sheet = covariance(rng, 3), Sheet()
    state = measured(sheet, P, np.zeros(3), np.array([[1.0, 0.0, 0.0]]), np.array([0.5]), np.array([0.2]))
    kept = (state.D[1], state.D[2], state.L[2][1])
    state.take()
    assert (state.D[1], state.D[2], state.L[2][1]) == kept
    x_new, P_new, _ = kalman(P, np.zeros(3), np.array([[1.0, 0, 0]]), np.array([[0.2]]), np.array([0.5]))
    close(dense(sheet.get(state.L), sheet.get(state.D)), P_new, P)
    np.testing.assert_allclose(sheet.get(state.correction), x_new, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("n", [1, 2, 4, 5])
def test_correlated_noise_is_decorrelated_first(n: int) -> None:
    """A full 2x2 R against the joint update."""
    rng = np.random.default_rng(20 + n)
    for _ in range(5):
        P, x = covariance(rng, n), rng.normal(size=n)
        H, nu, R = rng.normal(size=(2, n)), rng.normal(size=2), covariance(rng, 2)
        sheet = Sheet()
        state = measured(sheet, P, x, H, nu, [])
        state.rows, state.innovations, state.variances = decorrelated(
            state.rows, state.innovations, sheet.put(R), sheet.put(1e-12)
        )
        assert np.prod(sheet.get(state.variances)) == pytest.approx(np.linalg.det(R), rel=1e-8)
        state.take()
        state.take()
        x_new, P_new, _ = kalman(P, x, H, R, nu)
        close(dense(sheet.get(state.L), sheet.get(state.D)), P_new, P)
        assert np.max(np.abs(sheet.get(state.correction) - x_new) / np.sqrt(np.diag(P))) <= 1e-8


def test_independent_noise_is_left_alone() -> None:
    sheet = Sheet()
    rows, nu, R = sheet.put([[1.5, 2.0], [3.0, 4.0]]), sheet.put([0.1, 0.2]), sheet.put([[2.0, 0.0], [0.0, 3.0]])
    assert decorrelated(rows, nu, R, sheet.put(1e-9)) == (rows, nu, [R[0][0], R[1][1]])


def test_a_forgotten_correlation_would_be_seen() -> None:
    """The oracle itself."""
    rng = np.random.default_rng(9)
    P, x, H, nu, R = (
        covariance(rng, 3),
        np.zeros(3),
        rng.normal(size=(2, 3)),
        np.ones(2),
        np.array([[1, 0.5], [0.5, 1]]),
    )
    sheet = Sheet()
    state = measured(sheet, P, x, H, nu, np.diag(R))
    state.take()
    state.take()
    with pytest.raises(AssertionError):
        close(dense(sheet.get(state.L), sheet.get(state.D)), kalman(P, x, H, R, nu)[1], P)
