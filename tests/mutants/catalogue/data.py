"""Wrong drive data: the generator is given them, the reference keeps the true ones."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator
from typing import Any

from tests.mutants.mutant import ROOT, Mutant

DRIVES = ROOT / "model" / "drives"


def _with(section: str, **keys: Any) -> Callable[[Any], Any]:
    """The drive with some keys of a section replaced, unchecked."""
    return lambda drive: drive.model_copy(update={section: getattr(drive, section).model_copy(update=keys)})


def _swapped(values: list[float], i: int, j: int) -> list[float]:
    values = list(values)
    values[i], values[j] = values[j], values[i]
    return values


def _at(values: list[float], i: int, value: float) -> list[float]:
    return [*values[:i], value, *values[i + 1 :]]


def changes(drive: dict[str, Any]) -> Iterator[tuple[str, str, dict[str, Any], str]]:
    """The fault, the section, its keys, and the check that meets it first."""
    motor, model, tuning = drive["motor"], drive["model"], drive["filter"]
    torque = model["mechanics"] == "load_torque"
    salient = motor["inductance_d"] != motor["inductance_q"]
    for key in ("stator_resistance", "magnet_flux", "inductance_d"):
        yield f"{key} 1e-6 too large", "motor", {key: motor[key] * (1 + 1e-6)}, "A-B"
    if salient:
        swapped = {"inductance_d": motor["inductance_q"], "inductance_q": motor["inductance_d"]}
        yield "L_d and L_q swapped", "motor", swapped, "A-B"
        yield "L_q 1e-6 too large", "motor", {"inductance_q": motor["inductance_q"] * (1 + 1e-6)}, "A-B"
        yield "L_q = L_d", "motor", {"inductance_q": motor["inductance_d"]}, "A-B"
    yield "one pole pair more", "motor", {"pole_pairs": motor["pole_pairs"] + 1}, "A-B"
    if motor["friction"]:
        yield "no friction", "motor", {"friction": 0.0}, "A-B"
    if torque or motor["friction"]:
        yield "inertia 1e-3 too large", "motor", {"inertia": motor["inertia"] * 1.001}, "A-B"
    yield "sample time 1e-6 too large", "model", {"sample_time": model["sample_time"] * (1 + 1e-6)}, "A-B"
    other = "exact" if model["discretization"] == "euler" else "euler"
    yield f"discretised {other}", "model", {"discretization": other}, "A-B"
    if model["adaptive"]:
        yield "adaptive time halved", "model", {"adaptive_time": model["adaptive_time"] / 2}, "A-B"
    Q, R, P_0 = tuning["process_noise"], tuning["measurement_noise"], tuning["initial_covariance"]
    yield "Q of omega dropped", "filter", {"process_noise": _at(Q, 2, 0.0)}, "A-B"
    yield "Q of theta 1e-6 too large", "filter", {"process_noise": _at(Q, 3, Q[3] * (1 + 1e-6))}, "A-B"
    yield "Q of omega and theta swapped", "filter", {"process_noise": _swapped(Q, 2, 3)}, "A-B"
    yield "R of beta doubled", "filter", {"measurement_noise": _at(R, 1, 2 * R[1])}, "A-B"
    if R[0] != R[1]:
        yield "R swapped", "filter", {"measurement_noise": _swapped(R, 0, 1)}, "A-B"
    yield "P_0 of theta doubled", "filter", {"initial_covariance": _at(P_0, 3, 2 * P_0[3])}, "data"
    yield "P_0 of omega and theta swapped", "filter", {"initial_covariance": _swapped(P_0, 2, 3)}, "data"
    start = [0.0] * len(Q)
    yield "x_0 at half a turn", "filter", {"initial_state": _at(start, 3, 3.0)}, "data"
    if "ickf" in tuning["kinds"]:
        yield "one iteration more", "filter", {"max_iterations": tuning["max_iterations"] + 1}, "data"
        yield "eps ten times as large", "filter", {"tolerance": 10 * tuning["tolerance"]}, "data"
    box = drive["operating_box"]
    yield "largest voltage 1 % too large", "operating_box", {"voltage": 1.01 * box["voltage"]}, "data"
    yield "largest current 1 % too small", "operating_box", {"current": 0.99 * box["current"]}, "data"
    control = drive["control"]
    for key in ("current_bandwidth", "speed_bandwidth", "max_current", "dc_link"):
        yield f"{key} 1 % too large", "control", {key: 1.01 * control[key]}, "controller"
    yield "speed of the box 1 % too large", "operating_box", {"speed": 1.01 * box["speed"]}, "controller"


def data_mutants() -> list[Mutant]:
    """Of every shipped drive."""
    found = []
    for path in sorted(DRIVES.glob("*.toml")):
        drive = tomllib.loads(path.read_text(encoding="utf-8"))
        drive["model"].setdefault("adaptive_time", 1.0)
        for name, section, keys, check in changes(drive):
            checks = (f"{check} {drive['name']}",)
            found.append(
                Mutant(
                    "data",
                    f"{drive['name']}: {name}",
                    checks,
                    drive=_with(section, **keys),
                    group=f"data {path.stem}",
                    sort=name,
                )
            )
    return found
