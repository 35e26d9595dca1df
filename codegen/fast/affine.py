"""Along which states h is affine: there a linearisation is exact, wherever it is made."""

from __future__ import annotations

from functools import cache

import casadi as ca

from model.machines.state_space import StateSpaceModel

#: Operations whose derivatives tell where they are not affine.
SMOOTH = frozenset(
    getattr(ca, f"OP_{name}")
    for name in (
        "INPUT",
        "OUTPUT",
        "CONST",
        "ADD",
        "SUB",
        "MUL",
        "DIV",
        "NEG",
        "SQ",
        "TWICE",
        "INV",
        "SQRT",
        "SIN",
        "COS",
    )
)


@cache
def affine_states(model: StateSpaceModel) -> frozenset[int]:
    """States, by index, in which h is affine while the others are held: all together, not one by one.

    No second derivative of h with respect to two of them is there, which is told by structure; where h has a kink,
    which no derivative shows, none is taken. Of states that are affine only one at a time, as two factors of a product,
    the earlier ones are taken.

    Parameters
    ----------
    model : StateSpaceModel
    """
    h = ca.Function("h", [model.x], [model.numeric(model.h)])
    if any(h.instruction_id(k) not in SMOOTH for k in range(h.n_instructions())):
        return frozenset()
    slopes = ca.jacobian(model.h, model.x)
    outputs, n = slopes.shape
    rows, columns = ca.jacobian(ca.vec(slopes), model.x).sparsity().get_triplet()
    bends = {(int(row) // outputs, int(column)) for row, column in zip(rows, columns, strict=True)}
    found: set[int] = set()
    for i in range(n):
        if not any((i, j) in bends or (j, i) in bends for j in (*found, i)):
            found.add(i)
    return frozenset(found)
