"""Links "guard" and "data": what a step does with inputs it rejects, and what it starts from.

Guard: some samples from the operating box, then one whose voltage or current is no number or beyond its limit, then
one without a voltage. By hand: the time update with the last voltage that was good, and nothing else.

Data: tuning, limits and start as the drive file states them, in the Python module and in what the C's ``_init`` leaves.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.filters.program import FilterStep
from runtime.estimator.c_backend import CBackend
from runtime.estimator.folder import GeneratedFolder
from runtime.estimator.numpy_backend import NumpyBackend
from runtime.proof.compare import covariance_scale, minuend_scale
from runtime.proof.inverter import lost_volts
from runtime.proof.motors import Plant
from runtime.proof.reference import Reference, make_reference
from runtime.proof.result import Link, Row

Array = NDArray[Any]

#: As links A-B and B-C allow together, in sigmas of the prediction: the same float64 steps, three on end.
ALLOWED = 2e-9
#: The gain is known to the roundings of Pyy times its condition, an estimate to that share of an innovation of some
#: sigmas: where Pyy is so ill-conditioned that three such roundings are more than is allowed, they are.
PER_CONDITION = 3 * float(np.finfo(float).eps) / ALLOWED

#: Where Gauss-Newton does not contract, as from a current at its limit that lies a hundred sigmas off, each iterate
#: grows the roundings of the one before, tenfold on ``ipmsm_flux``, whatever the form or the root. By how much is
#: measured: the reference once more from a state that is rounded otherwise, so many times, each sign drawn. A step
#: of hundreds of operations is then judged by so many roundings; 145 were met in 5600 samples with either gain.
ROUNDED_ANEW, ROUNDINGS = 4, 300

REJECTED, NOT_CONVERGED = 1, 2

#: Factors on the limit, and what is no number; in the voltage and in the current, on either axis.
BAD = (1.0 + 2e-7, -1.0 - 2e-7, float("nan"), float("inf"), float("-inf"))
#: The first sample's share of the voltage drawn: turned by any angle it stays within its limits, and so does 0.7.
FIRST = 0.5
#: Limits themselves are good.
GOOD = (1.0, -1.0)


def link_guard(
    module: ModuleType,
    step: FilterStep,
    drive: str,
    form: str,
    parameters: Mapping[str, Any],
    motor: Plant,
    draws: tuple[Array, Array, Array, Array],
) -> Link:
    """One form of the filter, float64, against the reference, over three samples each.

    Parameters
    ----------
    draws : tuple
        x (N, n), P (N, n, n), u (N, 2) V, y (N, 2) A of the operating box; each is taken with every fault in turn.
    """
    reference = make_reference(parameters, step.kind, step.gain, draws[0][0], motor)
    if step.iteration_proof:
        reference.N_max = 1
    first = _after(reference, *draws)
    x, P, u, y, first = (np.repeat(array, len(_faults()), axis=0) for array in (*draws, first))
    advance = parameters["motor"]["pole_pairs"] * parameters["model"]["sample_time"] * first[:, 2]
    x, u, y = _before_the_turn((x, u, y), first[:, module.ANGLE], advance, module.ANGLE)
    faults = _faults() * len(draws[0])
    u, y = _three_samples(u, y, faults, parameters["operating_box"])
    backend = NumpyBackend(module, step.kind, "float64")
    backend.reset(x.T.copy(), module.pack(np.moveaxis(P, 0, 2)))
    found = []
    for k in range(len(u)):
        backend.step(u[k].T.copy(), y[k].T.copy())
        state, words = backend.state()
        found.append((state.T, np.moveaxis(module.unpack(words), 2, 0), backend.status, backend.iterations))
    wanted = _by_hand(reference, parameters["operating_box"], module.ANGLE, x, P, u, y)
    return _compare(step, drive, form, module.ANGLE, wanted, found)


def _faults() -> list[tuple[int, float]]:
    """(which of u_alpha, u_beta, y_alpha, y_beta; what is put there, times the limit)."""
    return [(place, value) for place in range(4) for value in (*BAD, *GOOD)]


def _after(reference: Reference, x: Array, P: Array, u: Array, y: Array) -> Array:
    """The estimates after the first of the three samples."""
    reference.x, reference.P = x.copy(), P.copy()
    reference.step(FIRST * u, y)
    return reference.x


def _before_the_turn(
    vectors: tuple[Array, Array, Array], first: Array, advance: Array, angle: int
) -> tuple[Array, Array, Array]:
    """Every second draw turned, state, voltage and current, so that its angle passes pi in an update or coasting.

    ``first``: the angle after the first sample; ``advance``: how far it goes in one (both N, rad).
    """
    turn = np.copysign(np.pi, advance) - np.linspace(-0.75, 1.75, len(first)) * advance - first
    turn[::2] = 0.0
    turned = tuple(array.copy() for array in vectors)
    for array in turned:
        a, b = array[:, 0].copy(), array[:, 1].copy()
        array[:, 0], array[:, 1] = np.cos(turn) * a - np.sin(turn) * b, np.sin(turn) * a + np.cos(turn) * b
    turned[0][:, angle] += turn
    return turned[0], turned[1], turned[2]


def _three_samples(u: Array, y: Array, faults: list[tuple[int, float]], box: Mapping[str, Any]) -> tuple[Array, Array]:
    """u, y (3, N, 2): good, faulty, and one whose voltage is missing."""
    u, y = np.array([FIRST * u, 0.7 * u, u]), np.array([y, y, y])
    for b, (place, value) in enumerate(faults):
        target, limit = (u, box["voltage"]) if place < 2 else (y, box["current"])
        target[1, b, place % 2] = value * limit
    u[2, :, 0] = np.nan
    return u, y


def _by_hand(
    reference: Reference, box: Mapping[str, Any], angle: int, x: Array, P: Array, u: Array, y: Array
) -> list[Array]:
    """After each sample x, P, status, iterations, and what judges them, (N, 3, ..).

    That is sigmas of its prediction, condition of Pyy, |x - x_pred|, and what a rounding before makes of x and P.
    Samples with a good measurement are stepped side by side, and so are those that coast.
    """
    held, said = np.zeros_like(u[0]), []
    for u_k, y_k in zip(u, y, strict=True):
        u_good = np.all(np.abs(u_k) <= box["voltage"], axis=1)
        held = np.where(u_good[:, None], u_k, held)
        good = u_good & np.all(np.abs(y_k) <= box["current"], axis=1)
        after = [np.zeros_like(x), np.zeros_like(P), *np.zeros((2, len(x)), int), np.zeros_like(x), np.zeros(len(x))]
        after += [np.zeros_like(x), np.zeros_like(x), np.zeros_like(P)]
        if reference.kind == "ickf" and reference.N_max > 1:
            after[7][good], after[8][good] = _swayed(reference, angle, x[good], P[good], held[good], y_k[good])
        for some, sample in ((good, _measured), (~good, _coasting)):
            if some.any():
                reference.x, reference.P = x[some], P[some]
                for whole, part in zip(after[:7], sample(reference, held[some], y_k[some]), strict=True):
                    whole[some] = part
        x, P = after[0], after[1]
        said.append(after)
    return [np.stack(quantity, axis=1) for quantity in zip(*said, strict=True)]


def _measured(reference: Reference, u: Array, y: Array) -> tuple[Any, ...]:
    stages = reference.step(u, y)
    done = stages.get("converged", True) | (reference.N_max == 1)
    Pyy = stages["iterates"][0]["Pyy"] if "iterates" in stages else stages["Pyy"]
    moved = np.abs(reference.x - stages["x_pred"])
    status, count = np.where(done, 0, NOT_CONVERGED), stages.get("iterations", 1)
    return reference.x, reference.P, status, count, _sigma(stages["P_pred"]), np.linalg.cond(Pyy), moved


def _swayed(reference: Reference, angle: int, x: Array, P: Array, u: Array, y: Array) -> tuple[Array, Array]:
    """How far a sample's x (N, n) and P (N, n, n) move with a rounding of the x before it."""
    by_x, by_P, rng = np.zeros_like(x), np.zeros_like(P), np.random.default_rng(1)

    def after(start: Array) -> tuple[Array, Array]:
        reference.x, reference.P = start, P
        reference.step(u, y)
        return reference.x, reference.P

    x_after, P_after = after(x)
    for _ in range(ROUNDED_ANEW):
        x_anew, P_anew = after(x * (1.0 + np.finfo(float).eps * rng.choice([-1.0, 1.0], x.shape)))
        by_x = np.maximum(by_x, np.abs(_apart(x_anew, x_after, angle)))
        by_P = np.maximum(by_P, np.abs(P_anew - P_after))
    return by_x, by_P


def _apart(x: Array, other: Array, angle: int) -> Array:
    """x - other, their angles by the shorter way."""
    difference = x - other
    difference[..., angle] = np.remainder(difference[..., angle] + np.pi, 2 * np.pi) - np.pi
    return difference


def _coasting(reference: Reference, u: Array, y: Array) -> tuple[Any, ...]:
    reference.coast(u)
    return reference.x, reference.P, REJECTED, 0, _sigma(reference.P), 0.0, 0.0


def _sigma(P: Array) -> Array:
    return np.asarray(np.sqrt(np.einsum("bii->bi", P)))


def _compare(step: FilterStep, drive: str, form: str, angle: int, wanted: list[Array], found: list[Any]) -> Link:
    x, P, status, counts, predicted, condition, moved, *swayed = wanted
    x_found, P_found, status_found, counts_found = (np.stack([s[k] for s in found], axis=1) for k in range(4))
    dx = _apart(x_found, x, angle)
    # What the rounding of one sample leaves in P the next ones carry on, and their gain is known no better than that.
    carried = np.maximum.accumulate(minuend_scale(predicted, condition), axis=1)
    unsure = np.einsum("bkii->bki", carried[:, :-1]) / predicted[:, 1:] ** 2
    by_gain = np.maximum.accumulate(moved * np.pad(unsure.max(axis=2), ((0, 0), (1, 0)))[..., None], axis=1)
    known = predicted * np.maximum(1.0, PER_CONDITION * condition[..., None])
    grown_x, grown_P = (np.maximum.accumulate(ROUNDINGS / ALLOWED * part, axis=1) for part in swayed)
    error_x = np.abs(dx) / np.maximum.reduce([known, by_gain, grown_x, np.abs(x)])
    error_P = np.abs(P_found - P) / np.maximum.reduce([covariance_scale(P), carried, grown_P])
    outside = ~((x_found[..., angle] >= -np.pi) & (x_found[..., angle] < np.pi))
    bits = REJECTED | NOT_CONVERGED
    rows = (
        Row("15-17", "x, good, bad and missing", "estimate", _worst(error_x), ALLOWED, int(error_x.size)),
        Row("15-17", "P, good, bad and missing", "covariance", _worst(error_P), ALLOWED, int(error_P.size)),
        Row("34", "theta in [-pi, pi)", "angles outside", float(np.sum(outside)), 0.0, int(outside.size)),
        _equal("status", "what it says of the input", status, status_found & bits),
        _equal("iterations", "0 without a measurement", counts, counts_found),
    )
    claim = f"reference = {form} form, inputs rejected"
    return Link("guard", claim, drive, step.kind, step.gain, f"{len(x)} times three samples", rows)


def _equal(stage: str, meaning: str, wanted: Array, found: Array) -> Row:
    return Row("33", stage, meaning, float(np.sum(wanted != found)), 0.0, int(wanted.size))


def _worst(error: Array) -> float:
    return float(error.max()) if np.isfinite(error).all() else float("inf")


# --- data


def link_data(folder: GeneratedFolder, kind: str, gain: str, parameters: Mapping[str, Any], motor: Plant) -> Link:
    """The numbers of module and ``_init``, one by number, as float32 of the drive file's.

    Parameters
    ----------
    folder : GeneratedFolder
        The generated folder.
    kind : str
        Filter kind, such as "ickf".
    gain : str
        "cubature" or "jacobian"; matters to the ICKF alone.
    parameters : mapping of str to Any
        Sections of the drive file, parsed.
    motor : Plant
        The motor's data.
    """
    wanted = _stated(parameters)
    defaults = folder.module.DEFAULTS
    backend = CBackend(folder, kind, "float32", lanes=False)
    n = len(defaults["x_0"])
    backend.reset(np.zeros(n, dtype=np.float32), np.zeros(n * (n + 1) // 2, dtype=np.float32))
    c = backend.filters[0]
    whole = backend._ffi.buffer(backend.filters)
    whole[:] = b"\x5a" * len(whole)  # memory is not zero on the chip
    backend._init(backend.filters)
    loaded = {name: np.array(_plain(getattr(c, name))) for name in wanted}
    rows = [_same(f"{name}, Python", np.array(defaults[name]), wanted[name]) for name in wanted]
    rows += [_same(f"{name}, C", loaded[name], wanted[name]) for name in wanted]
    x_0 = np.array(defaults["x_0"])
    rows += [_same("x_0, C", np.array(_plain(c.x_0)), x_0), *_start(parameters, motor, x_0)]
    rows += [
        _same("x after reset", np.array(_plain(c.x)), x_0),
        _same(
            "P after reset",
            np.array(_plain(getattr(c, folder.module.COVARIANCE))),
            folder.module.pack(np.diag(defaults["P_0"])),
        ),
        _same("voltage held after reset", np.array(_plain(c.u_held)), np.zeros(2)),
    ]
    kept = [name for name in ("nis", "repairs", "iterations") if hasattr(c, name)]
    rows += [_same(f"{name} after init", np.array(getattr(c, name)), np.array(0)) for name in kept]
    others = [
        name for name in defaults if hasattr(c, name) and name not in (*wanted, "x_0")
    ]  # what no drive file states: C as Python
    rows += [_same(f"{name}, C", np.array(getattr(c, name)), np.array(defaults[name])) for name in others]
    return Link("data", "drive file = module = _init", folder.drive, kind, gain, "all numbers", tuple(rows))


def _stated(parameters: Mapping[str, Any]) -> dict[str, Array]:
    """Tuning and limits by the generated names."""
    tuning, box = parameters["filter"], parameters["operating_box"]
    values = {
        "Q": tuning["process_noise"],
        "R": tuning["measurement_noise"],
        "P_0": tuning["initial_covariance"],
        "tolerance": tuning["tolerance"],
        "max_iterations": tuning["max_iterations"],
        "u_max": box["voltage"],
        "y_max": box["current"],
    }
    return {name: np.array(value, dtype=float) for name, value in values.items()}


def _start(parameters: Mapping[str, Any], motor: Plant, x_0: Array) -> list[Row]:
    """The stated start; else no current, speed, angle or load, and the motor's data for slow states."""
    stated = parameters["filter"].get("initial_state")
    if stated is not None:
        return [_same("x_0 as stated", x_0, np.array(stated))]
    slow = [
        lost_volts(parameters) if word == "dead_time_voltage" else parameters["motor"][word]
        for word in parameters["model"].get("adaptive", ())
    ]
    mechanical = np.zeros(len(x_0) - 2 - len(slow))
    # 1e-6 of an ampere: x_0 is held to 1e-16 of a flux linkage, over an inductance of 1e-6 H at least.
    at_rest = float(np.max(np.abs(motor.h(x_0))))
    return [
        Row("5", "h(x_0)", "current at the start, A", at_rest, 1e-6, 2),
        _same("x_0 behind the electrical states", x_0[2:], np.array([*mechanical, *slow])),
    ]


def _plain(value: Any) -> Any:
    return value if isinstance(value, int | float) else list(value)


def _same(stage: str, found: Array, wanted: Array) -> Row:
    different = np.float32(found) != np.float32(wanted) if found.shape == wanted.shape else np.ones(1)
    return Row("-", stage, "as stated", float(np.sum(different)), 0.0, int(wanted.size))
