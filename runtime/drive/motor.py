"""The true motor of a simulation: the drive file's data times factors, in the order of the generated plant."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.estimator.folder import GeneratedFolder
from runtime.system.errors import UserError

Array = NDArray[Any]

#: Motor data that may differ from the filter's.
FACTORS = ("R", "L_d", "L_q", "psi_m", "J")


def true_motor(folder: GeneratedFolder, factors: Mapping[str, ArrayLike]) -> Array:
    """Data of the motor that turns: (6,) or, for factors of shape (B,), (6, B).

    R in ohm, 1 / L_d and 1 / L_q in 1/H, psi_m in Wb, 1 / J in 1/(kg m^2), D in N m s/rad, as ``host/*_plant.h`` says.

    Parameters
    ----------
    folder : GeneratedFolder
    factors : mapping
        Factors on R, L_d, L_q, psi_m, J; 1 where none is given.

    Raises
    ------
    UserError
        An unknown name, a factor that is not a positive number, or two inductances of a machine that has one.
    """
    for name in factors:
        if name not in FACTORS:
            raise UserError(f"no motor datum '{name}' to vary; there are: {', '.join(FACTORS)}.")
    f = {name: np.asarray(factors.get(name, 1.0), dtype=float) for name in FACTORS}
    for name, values in f.items():
        if not (np.all(np.isfinite(values)) and np.all(values > 0)):
            raise UserError(f"the factor on {name} must be a positive number.")
    if "per_L_q" not in folder.manifest["plant"]["motor"] and np.any(f["L_d"] != f["L_q"]):
        raise UserError(f"the machine of drive '{folder.drive}' has one inductance: vary L_d and L_q together.")
    m = folder.manifest["parameters"]["motor"]
    data = (
        m["stator_resistance"] * f["R"],
        1 / (m["inductance_d"] * f["L_d"]),
        1 / (m["inductance_q"] * f["L_q"]),
        m["magnet_flux"] * f["psi_m"],
        1 / (m["inertia"] * f["J"]),
        np.asarray(m["friction"]),
    )
    return np.stack(np.broadcast_arrays(*data))
