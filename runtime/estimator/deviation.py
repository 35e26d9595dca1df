"""How well a filter says that it knows the rotor's angle: the standard deviation in its P."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def angle_deviation(module: Any, words: Array) -> Array:
    """Standard deviation of the electrical angle, rad, (N,).

    Of P = L D L^T only the angle's row of L is needed, and the pivots up to its own.

    Parameters
    ----------
    module : module
        The drive's generated Python.
    words : (N, n (n + 1) / 2) array
        Covariances as the filter carries them.
    """
    earlier = module.ORDER[: module.ROWS[module.ANGLE]]
    pivots = words[:, [module.VARIANCES[state] for state in (*earlier, module.ANGLE)]].astype(float)
    row = words[:, [module.word(module.ANGLE, state) for state in earlier]].astype(float)
    return np.asarray(np.sqrt(np.sum(row**2 * pivots[:, :-1], axis=1) + pivots[:, -1]))
