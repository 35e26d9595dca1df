"""The CKF of paper_spmsm as formulas, for any symbolic package: what its user would type, and nothing cleverer.

Covariances are centred sums, P enters and leaves as its lower triangle, theta is wrapped. By eq. 5 h is linear, so
this is the ICKF's step too.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from model.schema import Drive

Vector = list[Any]
Matrix = list[list[Any]]


@dataclass(frozen=True)
class Package:
    """The functions that the formulas ask of a symbolic package."""

    sin: Callable[[Any], Any]
    cos: Callable[[Any], Any]
    sqrt: Callable[[Any], Any]
    floor: Callable[[Any], Any]


def ckf_step(p: Package, drive: Drive, x: Vector, P: Vector, Q: Vector, R: Vector, u: Vector, y: Vector) -> Any:
    """x, P, Q, R, u, y -> x+, P+; eq. 7 and 11-26."""
    n = len(x)
    X = [_euler(p, drive, point, u) for point in _points(_cholesky(p, _full(P, n)), x)]
    x_pred = _mean(X)
    P_pred = _covariance(X, x_pred, X, x_pred)
    for i in range(n):
        P_pred[i][i] = P_pred[i][i] + Q[i]
    X = _points(_cholesky(p, P_pred), x_pred)
    Y = [point[:2] for point in X]
    y_pred = _mean(Y)
    Pyy, Pxy = _covariance(Y, y_pred, Y, y_pred), _covariance(X, x_pred, Y, y_pred)
    for k in range(2):
        Pyy[k][k] = Pyy[k][k] + R[k]
    det = Pyy[0][0] * Pyy[1][1] - Pyy[0][1] * Pyy[0][1]
    W = [[Pyy[1][1] / det, -Pyy[0][1] / det], [-Pyy[0][1] / det, Pyy[0][0] / det]]
    K = [[row[0] * W[0][k] + row[1] * W[1][k] for k in range(2)] for row in Pxy]
    x_new = [x_pred[i] + K[i][0] * (y[0] - y_pred[0]) + K[i][1] * (y[1] - y_pred[1]) for i in range(n)]
    x_new[3] = x_new[3] - 2 * math.pi * p.floor(x_new[3] / (2 * math.pi) + 0.5)
    # K Pyy K^T = Pxy K^T
    P_new = [P_pred[i][j] - (Pxy[i][0] * K[j][0] + Pxy[i][1] * K[j][1]) for i in range(n) for j in range(i + 1)]
    return x_new, P_new


def _euler(p: Package, drive: Drive, x: Vector, u: Vector) -> Vector:
    m, T = drive.motor, drive.model.sample_time
    L, poles = m.inductance_d, m.pole_pairs
    emf = T * m.magnet_flux * poles / L * x[2]
    decay = 1 - T * m.stator_resistance / L
    return [
        decay * x[0] + emf * p.sin(x[3]) + T / L * u[0],
        decay * x[1] - emf * p.cos(x[3]) + T / L * u[1],
        (1 - T * m.friction / m.inertia) * x[2],
        x[3] + T * poles * x[2],
    ]


def _full(P: Vector, n: int) -> Matrix:
    return [[P[max(i, j) * (max(i, j) + 1) // 2 + min(i, j)] for j in range(n)] for i in range(n)]


def _cholesky(p: Package, P: Matrix) -> Matrix:
    n = len(P)
    S: Matrix = [[0] * n for _ in range(n)]
    for j in range(n):
        S[j][j] = p.sqrt(P[j][j] - _sum([S[j][k] * S[j][k] for k in range(j)]))
        for i in range(j + 1, n):
            S[i][j] = (P[i][j] - _sum([S[i][k] * S[j][k] for k in range(j)])) / S[j][j]
    return S


def _points(S: Matrix, x: Vector) -> list[Vector]:
    n, reach = len(x), math.sqrt(len(x))
    sides = ((c, sign) for sign in (reach, -reach) for c in range(n))
    return [[x[i] + sign * S[i][c] if i >= c else x[i] for i in range(n)] for c, sign in sides]


def _mean(points: list[Vector]) -> Vector:
    return [_sum(list(row)) / len(points) for row in zip(*points, strict=True)]


def _covariance(a: list[Vector], a_mean: Vector, b: list[Vector], b_mean: Vector) -> Matrix:
    da = [[value - m for value, m in zip(point, a_mean, strict=True)] for point in a]
    db = [[value - m for value, m in zip(point, b_mean, strict=True)] for point in b]
    return [
        [_sum([p[i] * q[j] for p, q in zip(da, db, strict=True)]) / len(a) for j in range(len(b_mean))]
        for i in range(len(a_mean))
    ]


def _sum(terms: Vector) -> Any:
    return sum(terms[1:], terms[0]) if terms else 0
