"""Wrong stages of the filters."""

from __future__ import annotations

from tests.mutants.mutant import Mutant

PAPER, FLUX = ("A-B paper_spmsm",), ("A-B ipmsm_flux",)
PEERS = ("A-B paper_spmsm ekf ukf", "A-B ipmsm_flux ekf ukf")


def _of(file: str, *rows: tuple[str, str, str, tuple[str, ...]]) -> tuple[Mutant, ...]:
    path = f"model/filters/{file}"
    return tuple(Mutant("filter", f"{path}: {name}", checks, path, old, new) for name, old, new, checks in rows)


CUBATURE = _of(
    "cubature.py",
    ("n for sqrt(n)", "return math.sqrt(n + self.kappa)", "return n + self.kappa", PAPER),
    ("sqrt(n - 1)", "return math.sqrt(n + self.kappa)", "return math.sqrt(n + self.kappa - 1)", PAPER),
    (
        "weight 1 / n",
        "self.kappa / (n + self.kappa), 0.5 / (n + self.kappa)",
        "self.kappa / (n + self.kappa), 1.0 / (n + self.kappa)",
        PAPER,
    ),
    (
        "weight 1e-6 too large",
        "self.kappa / (n + self.kappa), 0.5 / (n + self.kappa)",
        "self.kappa / (n + self.kappa), 0.5000005 / (n + self.kappa)",
        PAPER,
    ),
    (
        "centre without its weight",
        "return centre * products[0] + weight * _sum(products[1:]) if rule.kappa else",
        "return weight * _sum(products[1:]) if rule.kappa else",
        PEERS,
    ),
    ("Cholesky's sign", "S[i][j] = (P[i][j] - sum(", "S[i][j] = (P[i][j] + sum(", PAPER),
    ("Cholesky's diagonal", "ca.sqrt(P[j][j] - sum(S[j][k] * S[j][k] for k in range(j)))", "ca.sqrt(P[j][j])", PAPER),
    (
        "rows for columns of S",
        "minus = [[centre[i] - step[i, c] if (i, c) in step else",
        "minus = [[centre[i] - step[model.order[c], row[i]] if row[i] <= c else",
        PAPER,
    ),
    (
        "order for its inverse",
        "P = [[P[i][j] for j in order] for i in order]",
        "order = tuple(order.index(k) for k in range(n))\n    P = [[P[i][j] for j in order] for i in order]",
        ("A-B spmsm_adaptive",),
    ),
    ("one side only", "minus = [[centre[i] - step[i, c]", "minus = [[centre[i] + step[i, c]", PAPER),
    ("mean about nothing", "return [a + d for a, d in zip(first, offset, strict=True)]", "return first", PAPER),
    ("mean of all but one", "for point in pts[1:]]) for i", "for point in pts[2:]]) for i", PAPER),
    ("deviation's sign in one place", "dev = [[value - m for value, m", "dev = [[value + m for value, m", PAPER),
    ("products of one side", "products = [p[i] * q[j] for", "products = [p[i] * q[i % len(q)] for", PAPER),
    ("coasting unwrapped", 'b.output("x", model.kept(x_pred))', 'b.output("x", x_pred)', PAPER),
    ("determinant's sign", "Pyy[0][0] * Pyy[1][1] - Pyy[1][0]", "Pyy[0][0] * Pyy[1][1] + Pyy[1][0]", PAPER),
    (
        "inverse not exchanged",
        "W_00, W_10, W_11 = Pyy[1][1] / det, -Pyy[1][0] / det, Pyy[0][0] / det",
        "W_00, W_10, W_11 = Pyy[0][0] / det, -Pyy[1][0] / det, Pyy[1][1] / det",
        PAPER,
    ),
    ("off-diagonal of the inverse", "-Pyy[1][0] / det, Pyy[0][0] / det", "Pyy[1][0] / det, Pyy[0][0] / det", PAPER),
    (
        "innovation subtracted",
        "x = [x_pred[i] + (K[i][0] * innovation[0]",
        "x = [x_pred[i] - (K[i][0] * innovation[0]",
        PAPER,
    ),
    (
        "half of the second innovation",
        "x = [x_pred[i] + (K[i][0] * innovation[0] + K[i][1] * innovation[1])",
        "x = [x_pred[i] + (K[i][0] * innovation[0] + 0.5 * K[i][1] * innovation[1])",
        PAPER,
    ),
    ("P grows", "P = [[P_pred[i][j] - (KPyy", "P = [[P_pred[i][j] + (KPyy", PAPER),
    ("P = P_pred - K K^T", "KPyy = [[row[0] * Pyy[0][0] + row[1] * Pyy[1][0],", "KPyy = [[row[0],", PAPER),
    (
        "packed transposed",
        "for i in range(len(matrix)) for j in range(i + 1)]\n\n\n@dataclass",
        "for j in range(len(matrix)) for i in range(j, len(matrix))]\n\n\n@dataclass",
        PAPER,
    ),
)

NOISE = _of(
    "noise.py",
    ("Q dropped", "P[i][i] = P[i][i] + Q[i]", "P[i][i] = P[i][i] + 0 * Q[i]", PAPER),
    ("Q of the neighbour", "P[i][i] = P[i][i] + Q[i]", "P[i][i] = P[i][i] + Q[i - 1]", PAPER),
    ("Q subtracted", "P[i][i] = P[i][i] + Q[i]", "P[i][i] = P[i][i] - Q[i]", PAPER),
)

SIGMA_POINT = _of(
    "sigma_point.py",
    (
        "R dropped on beta",
        "Pyy[0][0], Pyy[1][1] = Pyy[0][0] + R[0], Pyy[1][1] + R[1]",
        "Pyy[0][0] = Pyy[0][0] + R[0]",
        PAPER,
    ),
    (
        "R exchanged",
        "Pyy[0][0], Pyy[1][1] = Pyy[0][0] + R[0], Pyy[1][1] + R[1]",
        "Pyy[0][0], Pyy[1][1] = Pyy[0][0] + R[1], Pyy[1][1] + R[0]",
        ("A-B spmsm_adaptive", "A-B spmsm_load_torque"),
    ),
    (
        "points about x, not x_pred",
        'points(b, rule, eq("19"), S, x_pred, model, "_pred")',
        'points(b, rule, eq("19"), S, [0.999 * v for v in x_pred], model, "_pred")',
        PAPER,
    ),
    (
        "deviations from the first point",
        'dev = deviations(b, eq("17"), X_prop, x_pred, states)',
        'dev = deviations(b, eq("17"), X_prop, X_prop[0], states)',
        PAPER,
    ),
    (
        "innovation about h of the first point",
        "innovation = [y[k] - y_pred[k] for k in range(2)]",
        "innovation = [y[k] - Y[0][k] for k in range(2)]",
        FLUX,
    ),
    (
        "Pxy of images alone",
        "spread(rule, dev_x, dev_y), scale",
        "spread(rule, [[*d, *d, *d, *d][: n] for d in dev_y], dev_y), scale",
        PAPER,
    ),
    (
        "innovation of one axis",
        "innovation = [y[k] - y_pred[k] for k in range(2)]",
        "innovation = [y[0] - y_pred[k] for k in range(2)]",
        PAPER,
    ),
)

ICKF = _of(
    "ickf.py",
    ("stale Jacobian", "H = _jacobian(b, model, x_j)", "H = _jacobian(b, model, x_pred)", FLUX),
    (
        "H's rows exchanged",
        "rows = [[H[k, i] for i in range(len(x_j))] for k in range(2)]",
        "rows = [[H[1 - k, i] for i in range(len(x_j))] for k in range(2)]",
        FLUX,
    ),
    (
        "iterate from x^j",
        "x_next = [x_pred[i] + (K[i][0] * innovation[0]",
        "x_next = [x_j[i] + (K[i][0] * innovation[0]",
        FLUX,
    ),
    (
        "eq. 31 without H (x_pred - x^j)",
        "- h_j[k] - sum(H[k][i] * back[i] for i in range(len(states)))",
        "- h_j[k]",
        FLUX,
    ),
    ("its sign", "- h_j[k] - sum(H[k][i] * back[i]", "- h_j[k] + sum(H[k][i] * back[i]", FLUX),
    (
        "Pyy without R",
        'Pyy[0][0], Pyy[1][1] = Pyy[0][0] + R[0], Pyy[1][1] + R[1]\n    b.lower("Pyy", "29"',
        'b.lower("Pyy", "29"',
        FLUX,
    ),
    (
        "points beside x^j",
        'X = points(b, CUBATURE, "19", S_pred, x_j, model, "_j")',
        'X = points(b, CUBATURE, "19", S_pred, [0.9 * v for v in x_j], model, "_j")',
        FLUX,
    ),
    (
        "P of the last iterate's Pyy dropped",
        'K = [arrays["K"][2 * i : 2 * i + 2] for i in range(len(states))]',
        'K = [arrays["K"][2 * i : 2 * i + 2][::-1] for i in range(len(states))]',
        FLUX,
    ),
    (
        "norm of one state",
        "change = sum((step * step for step in moved[1:]), moved[0] * moved[0])",
        "change = moved[0] * moved[0]",
        FLUX,
    ),
    (
        "norm unsquared",
        "change = sum((step * step for step in moved[1:]), moved[0] * moved[0])",
        "change = sum((step * step for step in moved[1:]), moved[0])",
        FLUX,
    ),
    (
        "called idle where it is not",
        "    if ca.depends_on(model.H, model.x):\n        return None\n",
        "    return 'idle'\n",
        FLUX,
    ),
    ("not wrapped", "    x = model.kept(x_last)\n", "    x = list(x_last)\n", ("A-B ipmsm_flux",)),
    (
        "Pxy = P_pred H, rows for columns",
        "Pxy = [[_dot(P_pred[i], H[k]) for k in range(2)]",
        "Pxy = [[_dot(P_pred[n - 1 - i], H[k]) for k in range(2)]",
        FLUX,
    ),
    (
        "points from P_pred, not from its root",
        '"S = chol(P_pred)", cholesky(unpack(P_pred, len(model.states)), model.order))',
        '"S = chol(P_pred)", unpack(P_pred, len(model.states)))',
        FLUX,
    ),
    ("second step starts where x_pred is", 'b.output("x_j", x_next)', 'b.output("x_j", arrays["x_pred"])', FLUX),
)

PEER_MUTANTS = (
    _of(
        "ekf.py",
        ("Q dropped", "P_pred, Q, (x, *inputs))", "P_pred, [0 * q for q in Q], (x, *inputs))", PEERS),
        ("F P F", "_product(FP, [[rows[j][i] for j in range(n)] for i in range(n)])", "_product(FP, rows)", PEERS),
        (
            "R dropped",
            "Pyy[0][0], Pyy[1][1] = Pyy[0][0] + R[0], Pyy[1][1] + R[1]",
            "Pyy[0][0] = Pyy[0][0] + R[0]",
            PEERS,
        ),
        (
            "innovation of h at nothing",
            "innovation = [y[k] - h[k] for k in range(2)]",
            "innovation = [y[k] + h[k] for k in range(2)]",
            PEERS,
        ),
        (
            "updates with what it rejected",
            "update = If(ACCEPTED, (Call(measurement_update(model)),), (Call(coast(model)),))",
            "update = If(ACCEPTED, (Call(measurement_update(model)),), (Call(measurement_update(model)),))",
            PEERS,
        ),
    )
    + _of(
        "ukf.py",
        ("kappa = 2", "kappa=1.0", "kappa=2.0", PEERS),
        (
            "measured with another kappa",
            "If(ACCEPTED, (Call(measurement_update(model, UNSCENTED)),)",
            'If(ACCEPTED, (Call(measurement_update(model, Rule("ukf", kappa=2.0))),)',
            PEERS,
        ),
    )
    + _of(
        "ckf.py",
        ("updates with what it rejected", "(Call(coast(model)),))", "(Call(measurement_update(model)),))", PAPER),
    )
)

FILTERS = (*CUBATURE, *NOISE, *SIGMA_POINT, *ICKF, *PEER_MUTANTS)
