"""Link "controller": the interrupt's body around a filter, by hand and generated; then NumPy and C, bit for bit.

Each sample is taken from the state the generated controller is in, so that a difference is that sample's own. The
filter inside is the generated one: the other links are about it.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from types import ModuleType, SimpleNamespace
from typing import Any

import cffi
import numpy as np
from numpy.typing import NDArray

from runtime.drive.interface import controller_declarations
from runtime.estimator.c_backend import c_sources
from runtime.estimator.compiler import build_library, compiler_name, open_library
from runtime.estimator.folder import GeneratedFolder
from runtime.proof.control import SENSED_MAX, Sample, best_currents, clarke, control, gains_of, torque_of
from runtime.proof.motors import Plant
from runtime.proof.probe import watched_locals
from runtime.proof.result import Link, Row

Array = NDArray[Any]

#: Float64, some fifty roundings, on the scale of a duty cycle, the DC link, the largest torque.
ALLOWED = 1e-12
#: The current allowed beyond the least that makes their torque: the generated ones take the curve of
#: maximum torque per ampere in a fixed number of operations, 0.26 % above it at the worst.
EXCESS = 3e-3
SAMPLES = 80
REJECTED, COMMAND_REJECTED = 1, 4


def settings() -> list[tuple[int, int, float]]:
    """(sensored, computation delay, share of dead time)."""
    return [(0, 0, 0.0), (0, 1, 0.02), (1, 0, 0.02), (1, 1, 0.0)]


def inputs(parameters: Mapping[str, Any], seed: int) -> tuple[Array, Array, Array]:
    """phase (N, 2) A, command (N, 2) rad/s and V, sensed (N, 2): in and out of reach, missing, and just allowed.

    Parameters
    ----------
    parameters : mapping of str to Any
        Sections of the drive file, parsed.
    seed : int
        Seed of what is random.
    """
    rng = np.random.default_rng(seed)
    box, c = parameters["operating_box"], parameters["control"]
    scale = rng.choice([0.01, 0.3, 1.0], (SAMPLES, 1))
    phase = scale * rng.uniform(-0.4, 0.4, (SAMPLES, 2)) * box["current"]
    command = np.column_stack(
        [scale[:, 0] * rng.uniform(-1, 1, SAMPLES) * box["speed"], np.full(SAMPLES, c["dc_link"])]
    )
    command[::5, 1] *= rng.uniform(0.2, 1.2, len(command[::5]))
    sensed = np.column_stack([rng.uniform(-1, 1, SAMPLES) * box["speed"], rng.uniform(-np.pi, np.pi, SAMPLES)])
    limits = 2 * box["speed"], 2 * c["dc_link"]
    bad = (np.nan, np.inf, -np.inf, 1e9, -1e9)
    for k, value in enumerate(bad):
        for axis in range(2):
            phase[6 + 10 * k + 3 * axis, axis] = value
            command[7 + 10 * k + 3 * axis, axis] = value
            sensed[8 + 10 * k + 3 * axis, axis] = value
    for k, sign in enumerate((1, -1)):
        command[61 + k], sensed[64 + k] = (sign * limits[0], sign * limits[1]), (sign * limits[0], sign * SENSED_MAX)
        phase[67 + k, 0] = sign * box["current"]
    beyond = 1.0 + 2.0**-22
    sensed[73], sensed[74, 1] = (beyond * limits[0], 0.0), -beyond * SENSED_MAX
    command[75, 0], command[76, 1] = -beyond * limits[0], beyond * limits[1]
    command[70, 1], command[71, 1] = 0.5, 0.0
    command[0] = np.nan  # the first command counts until there is one
    return phase, command, sensed


def link_control(
    folder: GeneratedFolder, kind: str, gain: str, parameters: Mapping[str, Any], motor: Plant
) -> list[Link]:
    """By hand against generated float64; generated float32 against C.

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
    return [
        _by_hand(folder.module, folder.drive, kind, gain, parameters, motor),
        _bits(folder, kind, gain, parameters),
    ]


def _by_hand(module: ModuleType, drive: str, kind: str, gain: str, parameters: Mapping[str, Any], motor: Plant) -> Link:
    math, errors = module.MATH["float64"], []
    for seed, (sensored, delay, dead) in enumerate(settings()):
        gains = gains_of(parameters, delay)
        gains[6] = dead * (50 if gains[6] else 1)  # of a V_d that the model has: all or none of it
        c = module.new_controller(np.float64, gains, sensored, delay)
        for phase, command, sensed in zip(*inputs(parameters, seed), strict=True):
            before = deepcopy(c)
            c.sensed = tuple(sensed)
            with np.errstate(all="ignore"), watched_locals(module) as seen:
                duty, status = module.foc_step(c, module.STEPS[kind], tuple(phase), tuple(command), math)
            i_d_best = -seen.get(("control", "d_against"), 0.0)
            i_d = seen.get(("control", "i_d_ref"), seen["control", "d_at_limit"])  # of a round rotor they are one
            i_ref = complex(i_d, seen["control", "i_q_ref"])
            with np.errstate(all="ignore"):
                wanted, held_now, rejected = _sample(
                    module, kind, parameters, motor, before, (phase, command, sensed), i_d_best
                )
            found = (np.array(duty), complex(*c.v_queued) if delay else complex(*c.v_acting), np.array(c.integrator))
            shifted = np.array([*c.v_acting]) - (before.v_queued if delay else c.v_acting)
            held = np.array(c.command_held) - held_now
            scales = parameters["control"]["dc_link"], parameters["control"]["dc_link"]
            errors.append(
                [
                    np.max(np.abs(found[0] - wanted.duty)),
                    abs(found[1] - wanted.v) / scales[0],
                    np.max(np.abs(found[2] - wanted.integrator) / np.maximum(1.0, np.abs(wanted.integrator))),
                    abs(i_ref - wanted.i_ref) / parameters["control"]["max_current"],
                    _excess(parameters["motor"], i_d_best, wanted.torque),
                    np.max(np.abs([*shifted, *held])),
                    float((int(status) & (REJECTED | COMMAND_REJECTED)) != rejected),
                ]
            )
    c = module.new_controller(np.float64, gains_of(parameters, 0), 0, 0)
    started = float(np.sum(np.array([*c.command_held, *c.command_max]) != _commands(parameters)))
    worst = [float(v) if np.isfinite(v) else float("inf") for v in np.max(np.array(errors), axis=0)]
    named = {
        "duty cycles": ALLOWED,
        "voltage, of the DC link": ALLOWED,
        "integrators": ALLOWED,
        "reference currents, of the largest": ALLOWED,
        "reference current beyond the least, of it": EXCESS,
        "delay and commands held": 0.0,
        "status": 0.0,
    }
    rows = tuple(
        Row("-", name, "controller", value, allowed, len(errors))
        for (name, allowed), value in zip(named.items(), worst, strict=True)
    )
    rows += (Row("-", "commands to begin with, and their limits", "as stated", started, 0.0, 4),)
    claim = "controller by hand = generated float64"
    return Link("controller", claim, drive, kind, gain, f"{len(errors)} samples", rows)


def _excess(motor: Mapping[str, Any], i_d: float, torque: float) -> float:
    """How much more current makes a torque with this i_d, before the field is weakened, than the least."""
    current = abs(complex(i_d, torque / torque_of(motor, complex(i_d, 1.0))))
    return current / max(abs(best_currents(motor, torque, torque_of)), 1e-300) - 1


def _commands(parameters: Mapping[str, Any]) -> Array:
    """Standstill and the drive's DC link; twice the box's speed and twice that link."""
    link = parameters["control"]["dc_link"]
    return np.array([0.0, link, 2 * parameters["operating_box"]["speed"], 2 * link])


def _sample(
    module: ModuleType,
    kind: str,
    parameters: Mapping[str, Any],
    motor: Plant,
    c: SimpleNamespace,
    given: tuple[Array, Array, Array],
    i_d_best: float,
) -> tuple[Sample, Array, int]:
    """One sample by hand from the state ``c`` with this d current of the least one; commands held, status."""
    phase, command, sensed = given
    box, link = parameters["operating_box"], parameters["control"]["dc_link"]
    i = clarke(phase)
    measured = (np.float64(i.real), np.float64(i.imag))
    status = int(module.STEPS[kind](c.filter, c.v_acting, measured, module.MATH["float64"])) & REJECTED
    x = np.array(c.filter.x, dtype=float)
    if not (abs(i.real) <= box["current"] and abs(i.imag) <= box["current"]):
        i = complex(*motor.h(x))
    held = np.array(c.command_held, dtype=float)
    good = np.abs(command) <= (2 * box["speed"], 2 * link)
    held[good] = command[good]
    status |= 0 if good.all() else COMMAND_REJECTED
    rotor = x[2:4]
    if c.sensored:
        if np.all(np.abs(sensed) <= (2 * box["speed"], SENSED_MAX)):
            rotor = sensed
        else:
            status |= COMMAND_REJECTED
    gains = np.array(c.gain, dtype=float)
    sample = control(parameters, i, rotor, x, held, gains, np.array(c.integrator, dtype=float), i_d_best)
    return sample, held, status


def _bits(folder: GeneratedFolder, kind: str, gain: str, parameters: Mapping[str, Any]) -> Link:
    """The C controller and its NumPy twin, each running on by itself."""
    ffi, library, foc = _compiled(folder, kind)
    module, single = folder.module, np.float32
    different, loaded = 0, 0
    math = module.MATH["float32"]
    for seed, (sensored, delay, dead) in enumerate(settings()):
        c = ffi.new(f"{foc}_t *")
        ffi.buffer(c)[:] = b"\x5a" * ffi.sizeof(c[0])  # memory is not zero on the chip
        getattr(library, f"{foc}_init")(c, delay)
        gains = gains_of(parameters, delay)
        loaded += int(np.sum(np.asarray(list(c.gain), single) != np.asarray(gains, single)))
        loaded += int(c.delay != delay) + int(c.sensored != 0) + int(list(c.sensed) != [0.0, 0.0])
        gains[6] = dead * (50 if gains[6] else 1)
        c.gain[6], c.sensored = single(gains[6]), sensored
        twin = module.new_controller(single, gains, sensored, delay)
        loaded += int(_words(c, module) != _words(twin, module))
        duty = ffi.new("float[3]")
        for phase, command, sensed in zip(*inputs(parameters, seed), strict=True):
            given = [tuple(single(v) for v in values) for values in (phase, command, sensed)]
            c.sensed = twin.sensed = given[2]
            status = getattr(library, f"{foc}_step")(c, given[0], given[1], duty)
            with np.errstate(all="ignore"):
                duties, code = module.foc_step(twin, module.STEPS[kind], given[0], given[1], math)
            same = list(duty) == [float(v) for v in duties] and status == int(code)
            different += int(not same or _words(c, module) != _words(twin, module))
    count = SAMPLES * len(settings())
    rows = (
        Row("-", "what _foc_init loads", "gains, limits, start", float(loaded), 0.0, len(settings())),
        Row("-", "duty cycles, status, struct", "samples that differ", float(different), 0.0, count),
    )
    data = f"{count} samples, {compiler_name()} -O0"
    return Link("D-E", "controller: NumPy float32 = C, bit for bit", folder.drive, kind, gain, data, rows)


def _words(c: Any, module: ModuleType) -> list[float]:
    names = ("integrator", "command_max", "command_held", "v_acting", "v_queued")
    values = [getattr(c, name) for name in names]
    values += [getattr(c.filter, name) for name in ("x", module.COVARIANCE, "u_held", "Q", "R")]
    return [float(v) for array in values for v in array]


def _compiled(folder: GeneratedFolder, kind: str) -> tuple[Any, Any, str]:
    prefix, sources = c_sources(folder, kind, "float32")
    foc = f"{prefix}_foc"
    sources |= {f"{foc}{end}": folder.text(f"{foc}{end}") for end in (".h", ".c")}
    ffi = cffi.FFI()
    ffi.cdef(controller_declarations(sources, prefix, foc))
    return ffi, open_library(ffi, build_library(sources, {}, ("-O0",))), foc
