"""Drive files: one TOML file states a motor, its discrete model and the filter's tuning.

>>> drive = load_drive("paper_spmsm")
>>> drive.motor.pole_pairs, drive.model.sample_time
(4, 2e-05)
"""

from __future__ import annotations

import difflib
import hashlib
import math
import re
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from model.machines import MACHINES, MachineError, find_machine, unknown_word
from model.machines.own import read_word, try_out
from model.mechanics import MECHANICS

DRIVES = Path(__file__).parent / "drives"


class DriveError(ValueError):
    """A drive file that cannot be used; the message is one line and says what, where and what would be right."""


class Unit:
    """Annotation of a physical key: its unit, used in error messages and tables."""

    def __init__(self, symbol: str) -> None:
        self.symbol = symbol


Resistance = Annotated[float, Field(ge=1e-4, le=1e3), Unit("ohm")]
Inductance = Annotated[float, Field(ge=1e-6, le=0.5), Unit("H")]
FluxLinkage = Annotated[float, Field(ge=1e-4, le=10.0), Unit("Wb")]
Inertia = Annotated[float, Field(ge=1e-8, le=1e3), Unit("kg m^2")]
Friction = Annotated[float, Field(ge=0.0, le=10.0), Unit("N m s / rad")]
SlowTime = Annotated[float, Field(ge=1e-2, le=1e6), Unit("s")]
SampleTime = Annotated[float, Field(ge=1e-6, le=1e-2), Unit("s")]
Current = Annotated[float, Field(ge=1e-3, le=1e5), Unit("A")]
Voltage = Annotated[float, Field(ge=1e-1, le=1e5), Unit("V")]
Bandwidth = Annotated[float, Field(ge=0.1, le=1e5), Unit("rad/s")]
Torque = Annotated[float, Field(ge=1e-3, le=1e5), Unit("N m")]
Speed = Annotated[float, Field(ge=1.0, le=1e4), Unit("rad/s")]
CycleCount = Annotated[int | None, Field(ge=100, le=1_000_000, strict=True), Unit("cycles")]
#: The C asks for 1e-18 .. 1e18 of Q and R: float32 must hold products and quotients of two.
Variance = Annotated[float, Field(ge=1e-18, le=1e12)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=False, allow_inf_nan=False)


class Motor(_Section):
    """Motor data, SI, amplitude-invariant, d axis on the magnet flux."""

    stator_resistance: Resistance
    inductance_d: Inductance
    inductance_q: Inductance
    magnet_flux: FluxLinkage
    pole_pairs: Annotated[int, Field(ge=1, le=100, strict=True)]
    inertia: Inertia
    friction: Friction


class Model(_Section):
    """Which equations, and how they are sampled.

    ``machine``: a shipped word, or ``FILE.py:CLASS`` (:mod:`model.machines.own`).
    ``adaptive`` motor data wander and return to the motor's own within ``adaptive_time``, where nothing is learnt.
    """

    machine: str
    mechanics: Literal["constant_speed", "load_torque"] = "constant_speed"
    discretization: Literal["euler", "exact"]
    sample_time: SampleTime
    adaptive: list[Literal["magnet_flux", "stator_resistance"]] = []
    adaptive_time: SlowTime = 1.0

    @property
    def return_rate(self) -> float:
        """What share of its way back an adaptive state goes in a sample: T / adaptive_time, to a power of two."""
        return float(2.0 ** round(math.log2(self.sample_time / self.adaptive_time)))

    @field_validator("machine")
    @classmethod
    def _shipped_or_own(cls, word: str) -> str:
        if word not in MACHINES and read_word(word) is None:
            raise ValueError(unknown_word(word))
        return word

    @field_validator("adaptive")
    @classmethod
    def _each_once(cls, words: list[str]) -> list[str]:
        for word in words:
            if words.count(word) > 1:
                raise ValueError(f"model.adaptive names '{word}' twice.")
        return words


class Filter(_Section):
    """Kinds to generate and their tuning; every number here stays data in the generated struct.

    ``root_order``: the states in the order in which P is factored (eq. 13, 18); by default that of the state.
    """

    kinds: Annotated[list[Literal["ekf", "ukf", "ckf", "ickf"]], Field(min_length=1)]
    gain: Literal["cubature", "jacobian"] = "cubature"
    max_iterations: Annotated[int, Field(ge=1, le=100, strict=True)] = 3
    tolerance: Annotated[float, Field(gt=0, le=1.0)] = 1e-6
    initial_state: list[Annotated[float, Field(ge=-1e6, le=1e6)]] | None = None
    initial_covariance: list[Variance]
    process_noise: list[Variance]
    measurement_noise: Annotated[list[Variance], Field(min_length=2, max_length=2)]
    root_order: list[str] | None = None


class OperatingBox(_Section):
    """Declared range: the certificate holds inside it, inputs beyond it are rejected by the step.

    Speed is mechanical. A drive that declares no box gets a wide one.
    """

    current: Current = 1000.0
    voltage: Voltage = 2000.0
    speed: Speed = 500.0
    load_torque: Torque = 20.0


class Control(_Section):
    """Field-oriented control: what the regulators' gains are computed from, and what the inverter offers."""

    dc_link: Voltage = 311.0
    max_current: Current = 20.0
    current_bandwidth: Bandwidth = 1500.0
    speed_bandwidth: Bandwidth = 60.0


class Budget(_Section):
    """What a step may cost; ``generate`` fails beyond it. Cycles are computed from published ones (150 MHz C28x).

    ``cycles``: the dearest filter alone; ``controller_cycles``: with the controller around it, the whole interrupt;
    ``k``: cycles an addition or multiplication is priced at, 2.5 typical, 5 the bound; ``ram_words``: the largest
    filter's state struct.
    """

    cycles: CycleCount = None
    controller_cycles: CycleCount = None
    k: Annotated[float, Field(ge=1.0, le=10.0)] = 2.5
    ram_words: Annotated[int | None, Field(ge=10, le=10_000, strict=True), Unit("16-bit words")] = None


class Drive(_Section):
    """A validated drive file.

    ``sha256`` is the hash of the file's text, with the machine file's behind it where there is one; it goes into the
    generated header. ``machine_text`` is the text of a machine file of one's own.
    """

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
    motor: Motor
    model: Model
    filter: Filter
    operating_box: OperatingBox = OperatingBox()
    control: Control = Control()
    budget: Budget = Budget()
    sha256: str = ""
    machine_text: Annotated[str, Field(exclude=True, repr=False)] = ""

    @model_validator(mode="after")
    def _machine_fits_motor(self) -> Drive:
        motor = self.motor
        if self.model.machine == "surface" and motor.inductance_d != motor.inductance_q:
            raise ValueError(
                f"motor.inductance_q = {motor.inductance_q:g} H differs from inductance_d = {motor.inductance_d:g} H; "
                "machine 'surface' needs them equal. Did you mean machine = 'salient' or 'salient_flux'?"
            )
        return self


#: T R / L up to which forward Euler follows the current well enough to stay locked (0.34 does not, 0.17 does).
EULER_LIMIT = 0.2


def cautions(drive: Drive) -> list[str]:
    """What is allowed but likely a mistake, one line each."""
    m, model = drive.motor, drive.model
    ratio = model.sample_time * m.stator_resistance / min(m.inductance_d, m.inductance_q)
    if model.discretization == "euler" and ratio > EULER_LIMIT:
        return [
            f"drive '{drive.name}': forward Euler with T R / L = {ratio:.2f}; above {EULER_LIMIT} the filter may lose "
            f"lock. Use discretization = 'exact', or sample_time <= {EULER_LIMIT / ratio * model.sample_time:.3g} s."
        ]
    return []


def shipped_drives() -> list[str]:
    """Names of the drives that come with the project, sorted."""
    return sorted(path.stem for path in DRIVES.glob("*.toml"))


def drive_path(drive: str | Path) -> Path:
    """The file behind a shipped name or a TOML path.

    Raises
    ------
    DriveError
        If there is neither a shipped drive nor a file of that name.
    """
    if str(drive) in shipped_drives():
        return DRIVES / f"{drive}.toml"
    path = Path(drive)
    if path.suffix == ".toml" and path.is_file():
        return path
    close = difflib.get_close_matches(str(drive), shipped_drives(), n=1)
    hint = f" Did you mean '{close[0]}'?" if close else ""
    raise DriveError(
        f"no drive '{drive}': neither a shipped one ({', '.join(shipped_drives())}) nor a TOML file.{hint}"
    )


def load_drive(drive: str | Path) -> Drive:
    """Read and validate a drive file.

    Parameters
    ----------
    drive : str or Path
        A shipped name (``"paper_spmsm"``) or the path of a TOML file.

    Raises
    ------
    DriveError
        With one line naming file, key, unit and range.
    """
    path = drive_path(drive)
    try:
        raw = path.read_bytes()
        data = tomllib.loads(raw.decode("utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise DriveError(f"drive '{path.name}': cannot be read: {error}") from None
    except (ValueError, RecursionError) as error:  # tomllib's own, a number or a nesting beyond all bounds
        raise DriveError(f"drive '{path.name}': not valid TOML: {error}") from None
    text = _unix(raw)
    machine_text = _machine_file(data, path)
    digest = hashlib.sha256(text + machine_text.encode()).hexdigest()
    return parse_drive(data, path.name, digest, machine_text)


def parse_drive(data: dict[str, Any], where: str, sha256: str = "", machine_text: str = "") -> Drive:
    """Validate the parsed TOML ``data``; ``where`` names the source in errors.

    ``machine_text`` is the text of the machine file, if ``model.machine`` names one.
    """
    for key in ("sha256", "machine_text"):
        if key in data:
            raise DriveError(f"drive '{where}': unknown key {key}.")
    try:
        drive = Drive.model_validate({**data, "sha256": sha256, "machine_text": machine_text})
    except ValidationError as error:
        problems = sorted(
            error.errors(), key=lambda problem: problem["type"] != "extra_forbidden"
        )  # a typo explains a missing key
        more = f" ({len(problems) - 1} more like it)" if len(problems) > 1 else ""
        raise DriveError(f"drive '{where}': {_explain(problems[0])}{more}") from None
    try:
        machine = find_machine(drive)
        _check_lengths(drive, [quantity.name for quantity in machine.states], where)
        if drive.model.machine not in MACHINES:
            try_out(drive, machine)
    except MachineError as error:
        raise DriveError(f"drive '{where}': {error}") from None
    return drive


def _unix(raw: bytes) -> bytes:
    """A check-out that turned \\n into \\r\\n must not change the hash in the generated header."""
    return raw.replace(b"\r\n", b"\n")


def _machine_file(data: dict[str, Any], path: Path) -> str:
    """The text of the machine file a drive file names, if it names one."""
    section = data.get("model")
    word = section.get("machine") if isinstance(section, dict) else None
    try:
        own = read_word(word) if isinstance(word, str) else None
        if own is None:
            return ""
        return _unix((path.parent / own.file).read_bytes()).decode("utf-8")
    except MachineError as error:
        raise DriveError(f"drive '{path.name}': {error}") from None
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8"
        raise DriveError(
            f"drive '{path.name}': machine file '{own.file if own else word}' cannot be read: {reason}. "
            "Its path is relative to the drive file."
        ) from None


def _check_lengths(drive: Drive, electrical: list[str], where: str) -> None:
    mechanical = [quantity.name for quantity in MECHANICS[drive.model.mechanics].states]
    states = electrical + mechanical + list(drive.model.adaptive)
    for key in ("initial_state", "initial_covariance", "process_noise"):
        values = getattr(drive.filter, key)
        if values is not None and len(values) != len(states):
            raise DriveError(
                f"drive '{where}': filter.{key} has {len(values)} entries; "
                f"this model has {len(states)} states: {', '.join(states)}."
            )
    order = drive.filter.root_order
    if order is not None and sorted(order) != sorted(states):
        raise DriveError(
            f"drive '{where}': filter.root_order names {', '.join(order) or 'nothing'}; "
            f"it must name each of the model's states once: {', '.join(states)}."
        )


_SECTIONS: dict[str, type[_Section]] = {
    "motor": Motor,
    "model": Model,
    "filter": Filter,
    "operating_box": OperatingBox,
    "control": Control,
    "budget": Budget,
}


def _explain(problem: Any) -> str:
    """One pydantic problem as a sentence a motor engineer can act on."""
    location = [str(part) for part in problem["loc"]]
    key = re.sub(r"\.(\d+)$", r"[\1]", ".".join(location))
    kind, value, limits = problem["type"], problem["input"], problem.get("ctx", {})
    section = _SECTIONS.get(location[0], Drive) if len(location) > 1 else Drive
    if kind == "value_error":
        return str(limits.get("error", problem["msg"]))
    if kind == "extra_forbidden":
        close = difflib.get_close_matches(location[-1], list(section.model_fields), n=1)
        return f"unknown key {key}." + (f" Did you mean '{close[0]}'?" if close else "")
    unit, low, high = _range(section, location[1] if len(location) > 1 else location[0])
    allowed = f" ({low:g} .. {high:g}{unit})" if low is not None and high is not None else ""
    if kind == "missing":
        return f"{key} is missing{allowed}."
    if kind in {"greater_than_equal", "less_than_equal"} and low is not None and high is not None:
        return (
            f"{key} = {value}{unit} is outside {low:g} .. {high:g}{unit}.{_scale_hint(value, unit.strip(), low, high)}"
        )
    negative = isinstance(value, int | float) and value <= 0
    if kind == "greater_than" or (kind == "greater_than_equal" and negative):
        what = "variances and tolerances must be positive" if "filter" in location else "must be positive"
        return f"{key} = {value} is not positive: {what}."
    if kind == "greater_than_equal":  # an entry of a list
        return f"{key} = {value!r} is below {limits['ge']:g}."
    if kind == "literal_error":
        return f"{key} = {value!r} is none of {limits.get('expected', '')}."
    return f"{key} = {value!r}: {problem['msg'].lower()}{allowed}."


def _range(section: type[BaseModel], key: str) -> tuple[str, float | None, float | None]:
    """Unit (with a leading blank) and closed range of a key, as annotated."""
    field = section.model_fields.get(key)
    if field is None:
        return "", None, None
    unit, low, high = "", None, None
    for item in field.metadata:
        unit = f" {item.symbol}" if isinstance(item, Unit) else unit
        low = getattr(item, "ge", low)
        high = getattr(item, "le", high)
    return unit, low, high


def _scale_hint(value: Any, unit: str, low: float, high: float) -> str:
    """The usual slip is a unit scale: 0.8 for 0.8 mH, 20 for 20 us."""
    for prefix, factor in (("m", 1e-3), ("u", 1e-6)):
        if isinstance(value, int | float) and unit and " " not in unit and low / factor <= value <= high / factor:
            return f" Did you mean {value:g} {prefix}{unit} = {value * factor:g}?"
    return ""
