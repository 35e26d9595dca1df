"""What a pair (alpha, beta) or an angle can be made of: amplitude-invariant Clarke transforms, and their way back."""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_SQRT3 = np.sqrt(3.0)


def _from_three(a: Array, b: Array, c: Array) -> tuple[Array, Array]:
    return (2 * a - b - c) / 3, (b - c) / _SQRT3


def _from_lines(ab: Array, bc: Array) -> tuple[Array, Array]:
    return (2 * ab + bc) / 3, bc / _SQRT3


#: By kind of quantity, the best first.
FRAMES: dict[str, dict[tuple[str, ...], Callable[..., tuple[Array, Array]]]] = {
    "i": {
        ("i_a", "i_b", "i_c"): _from_three,
        ("i_a", "i_b"): lambda a, b: (a, (a + 2 * b) / _SQRT3),
        ("i_a", "i_c"): lambda a, c: (a, -(a + 2 * c) / _SQRT3),
        ("i_b", "i_c"): lambda b, c: (-b - c, (b - c) / _SQRT3),
    },
    "u": {
        ("u_a", "u_b", "u_c"): _from_three,
        ("u_ab", "u_bc"): _from_lines,
        ("u_ab", "u_ca"): lambda ab, ca: _from_lines(ab, -ab - ca),
        ("u_bc", "u_ca"): lambda bc, ca: _from_lines(-bc - ca, bc),
        ("duty_a", "duty_b", "duty_c", "u_dc"): lambda a, b, c, dc: _from_three(a * dc, b * dc, c * dc),
    },
}

DUTY = ("duty_a", "duty_b", "duty_c")

#: Order and sign of three sensors: column k holds the current of phase word[k].
WIRINGS = tuple(sign + "".join(order) for sign in ("", "-") for order in permutations("abc"))


def rewired(y: Array, wiring: str) -> Array:
    """Give currents the order and sign of their sensors.

    Parameters
    ----------
    y : ndarray, (N, 2)
        i_alpha, i_beta as recorded, A.
    wiring : str
        Of :data:`WIRINGS`: "bac" where the column of a is the current of b and the other way round, "-abc" where all
        count the other way.

    Returns
    -------
    ndarray, (N, 2)
    """
    sign, order = (-1.0, wiring[1:]) if wiring[0] == "-" else (1.0, wiring)
    recorded = (y[:, 0], -y[:, 0] / 2 + _SQRT3 / 2 * y[:, 1], -y[:, 0] / 2 - _SQRT3 / 2 * y[:, 1])
    phases = {phase: sign * current for phase, current in zip(order, recorded, strict=True)}
    return np.column_stack(_from_three(phases["a"], phases["b"], phases["c"]))
