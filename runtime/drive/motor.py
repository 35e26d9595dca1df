"""The true motor of a simulation and its inverter: the drive file's data, times factors, as the C wants them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from runtime.estimator.folder import GeneratedFolder
from runtime.system.errors import UserError
from runtime.system.values import read_number, read_word

Array = NDArray[Any]

#: Longest Runge-Kutta step of the simulated motor, s, and as a share of its fastest time constant: a step then errs by
#: less than 1e-7 of what it changes.
LONGEST_STEP, STEP_SHARE = 12.5e-6, 0.05
#: Steps a sample at most.
MOST_STEPS = 5000

#: What a factor on a datum may be.
FACTOR_RANGE = (1e-3, 1e3)
#: Motor data that may differ from the filter's.
FACTORS = ("R", "L_d", "L_q", "psi_m", "J")


def parse_factors(text: str) -> dict[str, float]:
    """Factors on the true motor's data from ``R=1.1,L=0.9``; L is both inductances.

    Parameters
    ----------
    text : str
        Comma-separated; empty for none.

    Raises
    ------
    UserError
        An entry that is no NAME=FACTOR, an unknown name, or a factor that is not a positive number.
    """
    found: dict[str, float] = {}
    for entry in filter(None, (part.strip() for part in text.split(","))):
        name, _, value = (part.strip() for part in entry.partition("="))
        if not value:
            raise UserError(f"--factors '{entry}' is not NAME=FACTOR, such as R=1.1.")
        factor = read_number(value, f"--factors {name}:", *FACTOR_RANGE)
        for datum in ("L_d", "L_q") if name == "L" else (name,):
            read_word(datum, "--factors", ("L", *FACTORS))
            if datum in found:
                raise UserError(f"--factors '{text}' gives {datum} twice.")
            found[datum] = factor
    return found


def longest_step(folder: GeneratedFolder) -> float:
    """Longest Runge-Kutta step of the drive's simulated motor, s: of L / R, an electrical radian and J / D.

    Parameters
    ----------
    folder : GeneratedFolder

    Raises
    ------
    UserError
        A motor too quick for its sample time to be simulated in steps.
    """
    stated = folder.manifest["parameters"]
    m, T = stated["motor"], stated["model"]["sample_time"]
    rates: dict[str, float] = {
        "L / R": m["stator_resistance"] / min(m["inductance_d"], m["inductance_q"]),
        "an electrical radian": m["pole_pairs"] * stated["operating_box"]["speed"],
        "J / D": m["friction"] / m["inertia"],
    }
    fastest = max(rates, key=rates.__getitem__)
    step: float = min(LONGEST_STEP, T / 2, STEP_SHARE / rates[fastest])
    if step < T / MOST_STEPS:
        raise UserError(
            f"drive '{folder.drive}': the simulated motor, not the filter, cannot follow: {fastest} is "
            f"{1 / rates[fastest]:.2g} s, and a sample of {T:g} s would take more than {MOST_STEPS} steps."
        )
    return step


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


def inverter_of(
    parameters: Mapping[str, Any], dead_time: float | None = None, drop: float | None = None
) -> tuple[float, float]:
    """Dead time of a carrier period of one sample, s, and switch drop, V: as a drive file has them, unless stated.

    Parameters
    ----------
    parameters : mapping
        Sections of the drive file.
    dead_time : float, optional
        s.
    drop : float, optional
        V.
    """
    known = parameters.get("inverter") or {"dead_time": 0.0, "switching_frequency": None, "switch_drop": 0.0}
    periods = (known["switching_frequency"] or 0.0) * parameters["model"]["sample_time"] or 1.0  # a sample
    own = known["dead_time"] * periods
    return own if dead_time is None else dead_time, known["switch_drop"] if drop is None else drop
