"""Supervisor and drive in C: NumPy float32 = C, bit for bit; and what the drive does for its modes, by hand.

Every field of every struct is compared, filter and rival included. C runs from the memory that NumPy was in, lane by
lane; the drive runs on by itself, in C and in NumPy, each from its own power-up.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from types import ModuleType, SimpleNamespace
from typing import Any

import cffi
import numpy as np
from numpy.typing import NDArray

from runtime.estimator.c_backend import c_sources, declarations
from runtime.estimator.compiler import build_library, compiler_name, open_library
from runtime.estimator.folder import GeneratedFolder
from runtime.proof.align import aligned
from runtime.proof.control import clarke
from runtime.proof.drive_draws import count, draws
from runtime.proof.link_injection import injected, learnt
from runtime.proof.mode_walk import Walk, lane_of
from runtime.proof.modes import OFF, TORQUE, Modes
from runtime.proof.result import Link, Row

Array = NDArray[Any]

#: Lanes and interrupts of the supervisor; lanes that run as scalars too; interrupts of the drive, each delay.
LANES, INTERRUPTS, SCALARS, SAMPLES = 60, 45, 4, 90
#: Interrupts from memory of arbitrary bits.
ANY_MEMORY = 3000
#: By hand the currents and the square wave are summed in another order, on the scale of the number or of 1; what a last
#: bit of the currents is to the rival's state and covariance is as much as link B-C allows.
ALLOWED = 1e-9
#: Draws of what the DC link allows; some ten roundings of numbers about 1, of squares of speeds that differ little too.
LINKS, SHARE_ALLOWED = 2000, 1e-11
#: Bit of the status: with torque, the angle is not seen.
UNOBSERVABLE = 64
#: Place of the largest current among the controller's gains.
MOST = 5


def link_drive(
    folder: GeneratedFolder,
    kind: str,
    gain: str,
    parameters: Mapping[str, Any],
    effort: tuple[int, int] = (INTERRUPTS, SAMPLES),
) -> list[Link]:
    """What the drive does for its modes by hand; supervisor and drive, NumPy float32 against C.

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
    effort : tuple of int, optional
        Interrupts of the supervisor's lanes, and of the drive.
    """
    interrupts, samples = effort
    hand = Modes(parameters, flux=folder.manifest["states"][0]["unit"] == "Wb")
    compiled = Compiled(folder, kind)
    rows = (
        *_begins(compiled, folder.module),
        *_supervisor_bits(compiled, folder.module, hand, interrupts),
        any_memory(compiled, folder.module, ANY_MEMORY),
        _drive_bits(compiled, folder.module, kind, hand, samples),
    )
    drawn = 2 * count(hand, folder.module, samples)
    data = f"{LANES * interrupts} interrupts, {drawn} of the drive, {compiler_name()} -O0"
    claim = "supervisor and drive: NumPy float32 = C, bit for bit"
    bits = Link("D-E", claim, folder.drive, kind, gain, data, rows)
    found = by_hand(folder.module, kind, hand, samples)
    claim = "drive by hand = generated float64"
    return [Link("supervisor", claim, folder.drive, kind, gain, f"{drawn} interrupts", found), bits]


# --- by hand


def by_hand(module: ModuleType, kind: str, hand: Modes, samples: int) -> tuple[Row, ...]:
    """What the drive does around the controller and the supervisor, which are the generated ones.

    Parameters
    ----------
    module : ModuleType
        The generated module.
    kind : str
        Filter kind.
    hand : Modes
    samples : int
        Interrupts, for each delay.
    """
    math, step, worst, seen, bits = module.MATH["float64"], module.STEPS[kind], 0.0, set(), set()
    for delay in (0, 1):
        rng = np.random.default_rng(delay)
        d = module.new_drive(np.float64, delay)
        for _, phase, command in draws(d, module, hand, rng, np.float64, samples):
            wanted = deepcopy(d)
            seen.add(module.MODES[d.supervisor.mode])
            with np.errstate(all="ignore"):
                duty, inverter = module.drive_step(d, step, phase, command, math)
                duty_wanted, inverter_wanted = _interrupt(module, step, hand, wanted, phase, command)
            bits.add(int(d.status) & UNOBSERVABLE)
            found = [*_numbers(d), *duty, inverter]
            worst = max(worst, _deviation(found, [*_numbers(wanted), *duty_wanted, inverter_wanted]))
    missed = float(len(set(module.MODES) - seen))
    return (
        Row("-", "drive", "every field, duty cycles, inverter", worst, ALLOWED, 2 * count(hand, module, samples)),
        Row("-", "drive, modes", "not visited", missed, 0.0, len(seen)),
        Row("-", "drive, angle", "never seen, or always", float(2 - len(bits)), 0.0, 2 * count(hand, module, samples)),
        _by_link(module, hand),
    )


def _by_link(module: ModuleType, hand: Modes) -> Row:
    """What the DC link allows, over links, speeds and references, and what is no number."""
    rng, worst = np.random.default_rng(4), 0.0
    for _ in range(LINKS):
        omega = hand.speed * rng.uniform(-1.5, 1.5) * rng.choice([1.0, 0.02])
        reference = rng.choice([omega + 1e-3 * hand.speed * rng.uniform(-1, 1), hand.speed * rng.uniform(-1.5, 1.5)])
        given = np.array([hand.link * rng.uniform(0.3, 1.5), reference, omega])
        given = np.where(rng.random(3) < 0.05, rng.choice([np.nan, np.inf, -np.inf, 0.0, -1.0], 3), given)
        link, reference, omega = (np.float64(value) for value in given)
        with np.errstate(all="ignore"):
            (found,) = module.allow((reference, link), (omega,), module.MATH["float64"])
            wanted = hand.allowed_by_link(link, reference, omega)
        worst = max(worst, _deviation([found], [wanted]))
    return Row("-", "drive, DC link", "share of the largest current", worst, SHARE_ALLOWED, LINKS)


def _interrupt(
    module: ModuleType, step: Any, hand: Modes, d: SimpleNamespace, phase: Any, command: Any
) -> tuple[Any, Any]:
    """One interrupt: voltages and regulators made void where the supervisor says so, current limited by the mode."""
    math, c, s = module.MATH["float64"], d.control, d.supervisor
    mode, most = module.MODES[s.mode], c.gain[MOST]
    if s.fresh:
        c.v_acting = c.v_queued = (0.0, 0.0)
    if s.anew:
        c.integrator = (0.0,) * 4
    if hasattr(d, "resistance") and mode != "RUNNING":
        d.resistance = (np.float64(0.0),)
    if s.runs:
        if mode == "STARTING":
            i = clarke(np.array(phase))
            step(s.rival, c.v_acting, (np.float64(i.real), np.float64(i.imag)), math)
        speed = s.asked[0] if mode == "STARTING" else command[0]
        allowed = most / hand.most * hand.allowed_current(mode, s.eased[0])
        allowed *= hand.allowed_by_link(command[1], speed, c.filter.x[2])
        c.gain = tuple(allowed if k == MOST else value for k, value in enumerate(c.gain))
        duty, d.status = module.foc_step(c, step, phase, (speed, command[1]), math)
        c.gain = tuple(most if k == MOST else value for k, value in enumerate(c.gain))
        if mode in TORQUE:
            P = module.unpack(np.array(getattr(c.filter, module.COVARIANCE), dtype=float))
            d.status |= 0 if hand.sees(float(np.sqrt(P[3, 3])), c.filter.x[2]) else UNOBSERVABLE
        if hasattr(d, "resistance") and mode == "RUNNING":
            _learn(module, d, phase)
        if hasattr(d, "injection") and mode in TORQUE:
            told, (amplitude, sign) = "v_queued" if c.delay else "v_acting", d.injection
            v, rotor = complex(*getattr(c, told)), np.array(c.filter.x[2:4])
            faded = 1.0 / module.PER_FADED_SPEED
            duty, v = injected(rotor, np.array(duty), v, c.command_held[1], amplitude, sign, faded)
            d.injection = amplitude, -sign
            setattr(c, told, (v.real, v.imag))
    elif mode == "ALIGNING":
        duty = aligned(hand, d, np.array(phase), command)
    else:
        duty, d.status = (0.5, 0.5, 0.5), 0
    module.supervise(s, c.filter, d.status, phase, command[0], math)
    return duty, int(module.MODES[s.mode] in ("PROBING", "CATCHING", "STARTING", "ALIGNING", "RUNNING"))


def _learn(module: ModuleType, d: SimpleNamespace, phase: Any) -> None:
    """The resistance that the ripple shows, with currents that were not rejected, and what it takes of the voltage."""
    c, (amplitude, sign), before = d.control, d.injection, float(d.resistance[0])
    believed = complex(*module.believed_currents(c.filter.x, module.MATH["float64"]))
    if not d.status & module.INPUT_REJECTED:
        wave = (amplitude, sign if c.delay else -sign)
        before = learnt(np.array(c.filter.x[2:4]), clarke(np.array(phase)), believed, wave, before, module)
    v = complex(*c.v_acting) - before * believed
    d.resistance, c.v_acting = (before,), (v.real, v.imag)


def _numbers(value: Any) -> list[float]:
    """All numbers of a struct, in order."""
    if isinstance(value, SimpleNamespace):
        return [number for own in vars(value).values() for number in _numbers(own)]
    return [number for own in value for number in _numbers(own)] if isinstance(value, tuple) else [float(value)]


def _deviation(found: list[float], wanted: list[float]) -> float:
    a, b = np.array(found), np.array(wanted)
    if a.shape != b.shape:
        return float("inf")
    with np.errstate(all="ignore"):
        error = np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0.0, np.abs(a - b) / np.maximum(1.0, np.abs(b)))
    return float(np.max(error, initial=0.0)) if np.isfinite(error).all() else float("inf")


# --- C


class Compiled:
    """Filter, controller, supervisor and drive of a kind in C, and their structs as NumPy has them.

    Parameters
    ----------
    folder : GeneratedFolder
    kind : str
    """

    def __init__(self, folder: GeneratedFolder, kind: str) -> None:
        self.stem, sources = c_sources(folder, kind, "float32")
        names = [f"{self.stem}_{part}" for part in ("foc", "supervisor", "drive")]
        sources |= {f"{name}{end}": folder.text(f"{name}{end}") for name in names for end in (".h", ".c")}
        self.ffi, self.sources = cffi.FFI(), sources
        parts = [declarations(sources[f"{name}.h"], name, "float32") for name in (self.stem, *names)]
        parts = [part.partition("void runner_run")[0] for part in parts]
        self.ffi.cdef("".join([parts[0], *(part.split(";", 1)[1] for part in parts[1:])]))
        self.library = open_library(self.ffi, build_library(sources, {}, ("-O0",)))

    def function(self, name: str) -> Any:
        """Return a function of the drive's.

        Parameters
        ----------
        name : str
            Without the beginning that all names share.
        """
        return getattr(self.library, f"{self.stem}_{name}")

    def structs(self, part: str, count: int) -> tuple[Any, Array]:
        """Structs side by side, their memory filled as on a chip that was on, and their view.

        Parameters
        ----------
        part : str
            "supervisor", "drive", or empty for the filter.
        count : int
        """
        kind = "_".join(filter(None, (self.stem, part, "t")))
        made = self.ffi.new(f"{kind}[]", count)
        self.ffi.buffer(made)[:] = b"\x5a" * self.ffi.sizeof(made)
        return made, np.frombuffer(self.ffi.buffer(made), _dtype(self.ffi, self.ffi.typeof(kind)))


def _dtype(ffi: Any, kind: Any) -> Any:
    """A C type as NumPy's."""
    if kind.kind == "array":
        return np.dtype((_dtype(ffi, kind.item), (kind.length,)))
    if kind.kind == "primitive":
        return np.dtype({"int": np.int32, "float": np.float32}[kind.cname])
    fields = dict(kind.fields)
    return np.dtype(
        {
            "names": list(fields),
            "formats": [_dtype(ffi, own.type) for own in fields.values()],
            "offsets": [own.offset for own in fields.values()],
            "itemsize": ffi.sizeof(kind),
        }
    )


def store_struct(view: Array, struct: SimpleNamespace) -> None:
    """NumPy's numbers into C's memory.

    Parameters
    ----------
    view : ndarray
        Structs side by side, changed.
    struct : SimpleNamespace
    """
    for name in view.dtype.names or ():
        value = getattr(struct, name)
        if isinstance(value, SimpleNamespace):
            store_struct(view[name], value)
        else:
            view[name] = np.stack(value, axis=-1) if isinstance(value, tuple) else value


def _differ(view: Array, struct: SimpleNamespace) -> Array:
    """In which lanes C's memory has other numbers than NumPy's; what is no number in both is the same."""
    found = np.zeros(view.shape, dtype=bool)
    for name in view.dtype.names or ():
        value = getattr(struct, name)
        if isinstance(value, SimpleNamespace):
            found |= _differ(view[name], value)
            continue
        own = view[name]
        wanted = np.stack(np.broadcast_arrays(*value), axis=-1) if isinstance(value, tuple) else np.asarray(value)
        other = (own != wanted) & ~((own != own) & (wanted != wanted))
        found |= other.reshape((*view.shape, -1)).any(axis=-1)
    return found


def _begins(compiled: Compiled, module: ModuleType) -> list[Row]:
    """Power-up, and a self-test that failed, in memory that is not zero."""
    made, view = compiled.structs("supervisor", 1)
    compiled.function("supervisor_init")(made)
    begins = int(_differ(view, module.new_supervisor(np.float32)).sum())
    compiled.function("supervisor_refuse")(made)
    refused = module.new_supervisor(np.float32)
    refused.mode, refused.reason = module.MODES.index("FAULT"), module.REASONS.index("SELF_TEST")
    refuses = int(_differ(view, refused).sum())
    return [
        Row("-", "power-up", "structs that differ", float(begins), 0.0, 1),
        Row("-", "a self-test that failed", "structs that differ", float(refuses), 0.0, 1),
    ]


def _supervisor_bits(compiled: Compiled, module: ModuleType, hand: Modes, interrupts: int) -> list[Row]:
    """A walk in lanes, every interrupt in C from the same memory, and a few lanes as scalars."""
    walk = Walk(module, hand, LANES, np.float32, 1)
    (s, s_view), (f, f_view) = compiled.structs("supervisor", LANES), compiled.structs("", LANES)
    supervise, math, different, apart = compiled.function("supervise"), module.MATH["float32"], 0, 0
    for number in range(interrupts):
        status, phase, reference = walk.draw()
        alone = [(lane, lane_of(walk.s, lane), lane_of(walk.f, lane)) for lane in range(number % 10, LANES, 10)]
        store_struct(s_view, walk.s)
        store_struct(f_view, walk.f)
        taken = walk.step(status, phase, reference)
        for lane in range(LANES):
            i = float(phase[0][lane]), float(phase[1][lane])
            code = supervise(s + lane, f + lane, int(status[lane]), i, float(reference[lane]))
            different += int(code != taken[lane])
        different += int((_differ(s_view, walk.s) | _differ(f_view, walk.f)).sum())
        for lane, own_s, own_f in alone[:SCALARS]:
            given = status[lane], tuple(i[lane] for i in phase), reference[lane]
            with np.errstate(all="ignore"):
                code = module.supervise(own_s, own_f, *given, math)
            same = _numbers(own_s) + _numbers(own_f), _numbers(lane_of(walk.s, lane)) + _numbers(lane_of(walk.f, lane))
            apart += int(code != taken[lane] or _deviation(*same) != 0.0)
    return [
        Row("-", "supervisor, every field", "interrupts that differ", float(different), 0.0, LANES * interrupts),
        Row("-", "lanes = scalars", "interrupts that differ", float(apart), 0.0, SCALARS * interrupts),
    ]


def any_memory(compiled: Compiled, module: ModuleType, count: int, seed: int = 2) -> Row:
    """One interrupt from memory and inputs of arbitrary bits: a mode comes out, and what that mode allows.

    Half of the memories have a mode to begin with: of all numbers hardly any is one.

    Parameters
    ----------
    compiled : Compiled
    module : ModuleType
        Names the modes.
    count : int
        Interrupts.
    seed : int, optional
        Seed of what is random.
    """
    rng, supervise = np.random.default_rng(seed), compiled.function("supervise")
    (s, s_view), (f, _) = compiled.structs("supervisor", count), compiled.structs("", count)
    for memory in (s, f):
        compiled.ffi.buffer(memory)[:] = rng.bytes(compiled.ffi.sizeof(memory))
    s_view["mode"][::2] = rng.integers(0, len(module.MODES), s_view["mode"][::2].shape)
    given = np.frombuffer(rng.bytes(12 * count), np.float32).reshape(count, 3)
    for k, status in enumerate(rng.integers(-(2**31), 2**31, count).tolist()):
        phase = given[k, :2] if k % 3 else np.float32(0)
        i = tuple(float(v) for v in np.broadcast_to(phase, 2))
        supervise(s + k, f + k, status, i, float(given[k, 2]))
    valid = np.isin(s_view["mode"], range(len(module.MODES)))
    on = [k for k, mode in enumerate(module.MODES) if mode not in OFF]
    wrong = ~valid | (s_view["inverter"] != np.isin(s_view["mode"], on))
    return Row("-", "arbitrary memory", "no mode, or an inverter on that is off in it", float(wrong.sum()), 0.0, count)


def _drive_bits(compiled: Compiled, module: ModuleType, kind: str, hand: Modes, samples: int) -> Row:
    """The whole drive in C and its NumPy twin, each running on by itself."""
    different, math = 0, module.MATH["float32"]
    for delay in (0, 1):
        rng = np.random.default_rng(delay)
        made, view = compiled.structs("drive", 1)
        compiled.function("drive_init")(made, delay)
        twin, duty = module.new_drive(np.float32, delay), compiled.ffi.new("float[3]")
        different += int(_differ(view[0:1], twin).sum())
        for changed, phase, command in draws(twin, module, hand, rng, np.float32, samples):
            if changed:
                store_struct(view, twin)
            inverter = compiled.function("drive_step")(made, phase, command, duty)
            with np.errstate(all="ignore"):
                duties, told = module.drive_step(twin, module.STEPS[kind], phase, command, math)
            same = list(duty) == [float(v) for v in duties] and inverter == int(told)
            different += int(not same or bool(_differ(view, twin).any()))
    return Row(
        "-", "drive, every field", "interrupts that differ", float(different), 0.0, 2 * count(hand, module, samples)
    )
