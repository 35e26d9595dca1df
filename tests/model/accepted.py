"""Drives drawn over all that a drive file accepts: the ranges are read from the schema, the loader takes each."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from model.drives.load import parse_drive
from model.schema import Control, Drive, Inverter, Model, Motor, Tolerance

#: Machines of each word, and what else the equations hang on.
MACHINES = ("surface", "salient", "salient_flux")
ADAPTIVE = (
    [],
    ["magnet_flux"],
    ["stator_resistance", "dead_time_voltage"],
    ["dead_time_voltage", "stator_resistance", "magnet_flux"],
)


def accepted(section: Any, key: str) -> tuple[float, float]:
    """The closed range of a key."""
    bounds = section.model_fields[key].metadata
    (low,) = [bound.ge for bound in bounds if getattr(bound, "ge", None) is not None]
    (high,) = [bound.le for bound in bounds if getattr(bound, "le", None) is not None]
    return float(low), float(high)


def evenly(rng: np.random.Generator, low: float, high: float) -> float:
    """Evenly in the logarithm; the ends themselves now and then."""
    if rng.random() < 0.1:
        return float(rng.choice([low, high]))
    return min(high, max(low, math.exp(rng.uniform(math.log(low), math.log(high)))))


def draw_motor(rng: np.random.Generator, machine: str) -> dict[str, Any]:
    """Motor data of any size; round rotors, nearly round ones, ones without friction among them."""
    drawn = {
        key: evenly(rng, *accepted(Motor, key))
        for key in ("stator_resistance", "inductance_d", "inductance_q", "magnet_flux", "inertia")
    }
    drawn["pole_pairs"] = int(evenly(rng, *accepted(Motor, "pole_pairs")))
    drawn["friction"] = 0.0 if rng.random() < 0.3 else evenly(rng, 1e-12, accepted(Motor, "friction")[1])
    if machine == "surface" or rng.random() < 0.1:
        drawn["inductance_q"] = drawn["inductance_d"]
    elif rng.random() < 0.2:
        low, high = accepted(Motor, "inductance_q")
        near = drawn["inductance_d"] * (1 + rng.choice([-1, 1]) * 10 ** rng.uniform(-15, -2))
        drawn["inductance_q"] = min(high, max(low, near))
    return drawn


def draw_tolerance(rng: np.random.Generator) -> Tolerance:
    """Half-widths and a correlation time of any size; every fourth datum is exact."""
    keys = ("stator_resistance", "inductance", "magnet_flux", "dead_time")
    widths = {key: 0.0 if rng.random() < 0.25 else evenly(rng, 1e-6, accepted(Tolerance, key)[1]) for key in keys}
    times = {key: evenly(rng, *accepted(Tolerance, key)) for key in ("correlation_time", "unsure_samples")}
    return Tolerance(**widths, **times)


def draw_drive(rng: np.random.Generator, machine: str, mechanics: str, discretization: str, adaptive: Any) -> Drive:
    """A drive that the loader accepts; the filter's tuning is of no matter here."""
    states = 4 + (mechanics == "load_torque") + len(adaptive)
    model = {"machine": machine, "mechanics": mechanics, "discretization": discretization, "adaptive": list(adaptive)}
    model |= {key: evenly(rng, *accepted(Model, key)) for key in ("sample_time", "adaptive_time")}
    tuning = {"kinds": ["ckf"], "initial_covariance": [1.0] * states, "process_noise": [1.0] * states}
    tuning["measurement_noise"] = [1.0, 1.0]
    drawn = {"name": "drawn", "motor": draw_motor(rng, machine), "model": model, "filter": tuning}
    return parse_drive(drawn | draw_inverter(rng, model["sample_time"]), "drawn")


def draw_inverter(rng: np.random.Generator, T: float) -> dict[str, Any]:
    """What two inverters of three take of a voltage; of the third nothing is said."""
    if rng.random() < 0.3:
        return {}
    control = {"max_current": evenly(rng, *accepted(Control, "max_current"))}
    control["dc_link"] = evenly(rng, accepted(Control, "dc_link")[0], 3000.0)  # the operating box ends at 2000 V
    said = {"switch_drop": rng.uniform(*accepted(Inverter, "switch_drop"))}
    if rng.random() < 0.5:
        said["switching_frequency"] = evenly(rng, *accepted(Inverter, "switching_frequency"))
    longest = min(accepted(Inverter, "dead_time")[1], 0.25 / said.get("switching_frequency", 1 / T))
    return {"control": control, "inverter": said | {"dead_time": evenly(rng, 1e-9, longest)}}
