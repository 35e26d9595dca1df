"""Drive files: one TOML file states a motor, its discrete model and the filter's tuning.

>>> drive = load_drive("paper_spmsm")
>>> drive.motor.pole_pairs, drive.model.sample_time
(4, 2e-05)
"""

from __future__ import annotations

import difflib
import hashlib
import math
import os
import re
import stat
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from model.drives.states import check_states
from model.drives.text import EncodingError, read_text
from model.inverter import lost_voltage
from model.machines import MACHINES, MachineError, find_machine
from model.machines.own import read_word, try_out
from model.rating import rating
from model.schema import (
    Budget,
    Control,
    Drive,
    DriveError,
    Filter,
    Inverter,
    Model,
    Motor,
    OperatingBox,
    Rated,
    TargetChoice,
    Tolerance,
    Unit,
)

DRIVES = Path(__file__).parent

#: T R / L up to which forward Euler follows the current well enough to stay locked (0.34 does not, 0.17 does); of
#: T D / J no more is allowed.
EULER_LIMIT = 0.2

#: The back-EMF should be that many times the volts of a resistance in doubt; down to this share of the rated speed.
DOUBT_SHARE, SLOW_SHARE = 3.0, 0.05

#: Share of a motor's datum by which an adaptive state may stay off it, since float32 rounds its return away.
RETURN_LIMIT = 0.05


def cautions(drive: Drive) -> list[str]:
    """Warnings: entries that are allowed but likely a mistake, one line each.

    Parameters
    ----------
    drive : Drive
        A drive that is valid: every number in its range.

    Returns
    -------
    list of str
        Empty where nothing looks wrong.
    """
    m, model, lines = drive.motor, drive.model, []
    rates = {"T R / L": m.stator_resistance / min(m.inductance_d, m.inductance_q), "T D / J": m.friction / m.inertia}
    for word, rate in rates.items():
        share = model.sample_time * rate
        if model.discretization == "euler" and share > EULER_LIMIT:
            lines.append(
                f"drive '{drive.name}': forward Euler with {word} = {share:.2f}; above {EULER_LIMIT} "
                f"the filter may lose lock. Use discretization = 'exact', or sample_time <= {EULER_LIMIT / rate:.3g} s."
            )
    kept = 2.0**-25 / model.return_rate  # half a unit in the last place of a value is 2^-25 of it, or more
    if model.adaptive and kept > RETURN_LIMIT:
        lines.append(
            f"drive '{drive.name}': with model.adaptive_time = {model.adaptive_time:g} s float32 rounds the return of "
            f"{' and '.join(model.adaptive)} away within {min(kept, 1):.0%} of the motor's own; "
            f"{RETURN_LIMIT * 2**24.5 * model.sample_time:.2g} s or less returns."
        )
    return lines + _beyond_the_box(drive) + _beyond_the_limits(drive) + _of_tolerance(drive)


def _of_tolerance(drive: Drive) -> list[str]:
    """Where a tolerance does not help: a line each."""
    m, stated = drive.motor, drive.tolerance
    lines: list[str] = []
    if stated is None:
        return lines
    if stated.stator_resistance and "stator_resistance" not in drive.model.adaptive:
        task = rating(drive)
        volts = stated.stator_resistance * m.stator_resistance * task.current
        speed = DOUBT_SHARE * volts / (m.pole_pairs * m.magnet_flux)
        if speed > SLOW_SHARE * task.speed:
            lines.append(
                f"drive '{drive.name}': tolerance.stator_resistance is {volts:.2g} V at the rated load, too much "
                f"to tell speed by the back-EMF below {speed * 30 / math.pi:.0f} r/min: a load step may lose the "
                "rotor. Let the filter learn it: adaptive = ['stator_resistance']."
            )
    return lines


def _beyond_the_limits(drive: Drive) -> list[str]:
    """What is rated and is not allowed: a line each."""
    c, rated = drive.control, drive.rated
    if rated is None:
        return []
    power = rated.torque * rated.speed
    compared = [("torque", rated.torque, c.max_torque, "N m"), ("torque times rated.speed", power, c.max_power, "W")]
    return [
        f"drive '{drive.name}': rated.{what} = {value:.4g} {unit} is beyond control.max_{limit} = {most:g} {unit}: "
        "the controller will not reach it. Raise the limit, or state a smaller task."
        for (what, value, most, unit), limit in zip(compared, ("torque", "power"), strict=True)
        if most is not None and value > most
    ]


def _beyond_the_box(drive: Drive) -> list[str]:
    """What the controller may ask for though the step rejects it: a line each."""
    box, c = drive.operating_box, drive.control
    asked = [
        ("control.max_current", c.max_current, "current", box.current, "A", "rejects currents"),
        ("control.dc_link / sqrt(3)", c.dc_link / math.sqrt(3.0), "voltage", box.voltage, "V", "rejects voltages"),
    ]
    if drive.rated:
        asked.append(("rated.speed", drive.rated.speed, "speed", box.speed, "rad/s", "is not certified for speeds"))
        most = box.load_torque
        asked.append(("rated.torque", drive.rated.torque, "load_torque", most, "N m", "is not certified for loads"))
    return [
        f"drive '{drive.name}': {key} = {value:.4g} {unit} is beyond operating_box.{end} = {limit:g} {unit}: "
        f"the filter {outcome} that the controller may ask for. Widen the box, or ask for less."
        for key, value, end, limit, unit, outcome in asked
        if value > limit
    ]


def shipped_drives() -> list[str]:
    """Names of the drives that come with the project, sorted."""
    return sorted(path.stem for path in DRIVES.glob("*.toml"))


def drive_path(drive: str | Path) -> Path:
    """The file behind a shipped name or a TOML path.

    Parameters
    ----------
    drive : str | Path
        A shipped name or the path of a TOML file.

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
    raise DriveError(unknown_drive(drive))


def unknown_drive(word: str | Path, nor: str = "nor a TOML file") -> str:
    """One line for a word that names no drive: neither a shipped one, ``nor`` what else it might be.

    Parameters
    ----------
    word : str or Path
        What was given as a drive.
    nor : str, optional
        What else the place takes, as the end of "neither a shipped one ...".
    """
    there = _what_is_there(word)
    if there:
        return f"no drive '{word}': {there}"
    close = difflib.get_close_matches(str(word), shipped_drives(), n=1)
    hint = f" Did you mean '{close[0]}'?" if close else ""
    return f"no drive '{word}': neither a shipped one ({', '.join(shipped_drives())}) {nor}.{hint}"


def _what_is_there(word: str | Path) -> str:
    """Why a file or a pipe of that name is no drive file; empty where there is neither."""
    try:
        mode = os.stat(word).st_mode
    except (OSError, ValueError):
        return ""
    if stat.S_ISREG(mode):
        return "a drive file's name ends in .toml, which this one's does not."
    if stat.S_ISDIR(mode):
        return ""
    return "it is a pipe or a device, and a drive file is read more than once: write it to a file that ends in .toml."


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
        text = read_text(path)
        data = tomllib.loads(text)
    except (OSError, EncodingError) as error:
        raise DriveError(f"drive '{path.name}': cannot be read: {error}") from None
    except (ValueError, RecursionError) as error:  # tomllib's own, a number or a nesting beyond all bounds
        raise DriveError(f"drive '{path.name}': not valid TOML: {error}") from None
    machine_text = _machine_file(data, path)
    digest = hashlib.sha256((text + machine_text).encode()).hexdigest()
    return parse_drive(data, path.name, digest, machine_text)


def parse_drive(data: dict[str, Any], where: str, sha256: str = "", machine_text: str = "") -> Drive:
    """Validate the parsed TOML ``data``; ``where`` names the source in errors.

    Parameters
    ----------
    data : dict
        The tables of a drive file, as tomllib reads them.
    where : str
        Name of the source in errors; a drive file's name.
    sha256 : str, optional
        Hash of the drive file and its machine file, in hexadecimal digits.
    machine_text : str, optional
        Text of the machine file, if ``model.machine`` names one.

    Raises
    ------
    DriveError
        With one line naming source, key, unit and range.
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
        raise DriveError(f"drive '{where}': {explain(problems[0])}{more}") from None
    try:
        machine = find_machine(drive)
        check_states(drive, [quantity.name for quantity in machine.states], where)
        if drive.tolerance and drive.tolerance.dead_time and not lost_voltage(drive):
            raise DriveError(
                f"drive '{where}': tolerance.dead_time says how far off [inverter] may be, and there is none: "
                "state its dead_time, or switch_drop."
            )
        if drive.model.machine not in MACHINES:
            try_out(drive, machine)
    except MachineError as error:
        raise DriveError(f"drive '{where}': {error}") from None
    return drive


def _machine_file(data: dict[str, Any], path: Path) -> str:
    """The text of the machine file a drive file names, if it names one."""
    section = data.get("model")
    word = section.get("machine") if isinstance(section, dict) else None
    try:
        own = read_word(word) if isinstance(word, str) else None
        if own is None:
            return ""
        return read_text(path.parent / own.file)
    except MachineError as error:
        raise DriveError(f"drive '{path.name}': {error}") from None
    except (OSError, EncodingError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise DriveError(
            f"drive '{path.name}': machine file '{own.file if own else word}' cannot be read: {reason}. "
            "Its path is relative to the drive file."
        ) from None


_SECTIONS: dict[str, type[BaseModel]] = {
    "motor": Motor,
    "model": Model,
    "filter": Filter,
    "operating_box": OperatingBox,
    "control": Control,
    "inverter": Inverter,
    "budget": Budget,
    "rated": Rated,
    "tolerance": Tolerance,
    "target": TargetChoice,
}


def explain(problem: Any, sections: Mapping[str, type[BaseModel]] = _SECTIONS, top: type[BaseModel] = Drive) -> str:
    """One pydantic problem as a sentence a motor engineer can act on.

    Parameters
    ----------
    problem : dict
        An entry of ``ValidationError.errors()``.
    sections : mapping of str to model, optional
        The file's sections by name.
    top : model, optional
        What holds them.
    """
    location = [str(part) for part in problem["loc"]]
    key = re.sub(r"\.(\d+)$", r"[\1]", ".".join(location))
    kind, value, limits = problem["type"], problem["input"], problem.get("ctx", {})
    section = sections.get(location[0], top) if len(location) > 1 else top
    if kind == "value_error":
        return str(limits.get("error", problem["msg"]))
    if kind == "extra_forbidden":
        close = difflib.get_close_matches(location[-1], list(section.model_fields), n=1)
        return f"unknown key {key}." + (f" Did you mean '{close[0]}'?" if close else "")
    unit, low, high = accepted_range(section, location[1] if len(location) > 1 else location[0])
    allowed = f" ({low:g} .. {high:g}{unit})" if low is not None and high is not None else ""
    if kind == "missing":
        return f"{key} is missing{allowed}."
    if location[-1] == "magnet_flux" and value == 0:
        return (
            f"{key} = 0: a motor without magnets is not for this tool, whose filters see the rotor by its magnet flux. "
            f"With magnets, give their flux linkage{allowed}."
        )
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
    if kind == "string_pattern_mismatch":
        return (
            f"{key} = {value!r} is no name. Names stand in the C: a small letter, then small letters, digits and _, "
            "at most 40 of them."
        )
    if kind == "literal_error":
        return f"{key} = {value!r} is none of {limits.get('expected', '')}."
    return f"{key} = {value!r}: {problem['msg'].lower()}{allowed}."


def accepted_range(section: type[BaseModel], key: str) -> tuple[str, float | None, float | None]:
    """Unit (with a leading blank) and closed range of a key, as annotated; "" and None where there is none.

    Parameters
    ----------
    section : model
    key : str
    """
    field = section.model_fields.get(key)
    if field is None:
        return "", None, None
    unit, low, high = "", None, None
    parts = get_args(field.annotation) if type(None) in get_args(field.annotation) else ()  # of X | None
    inside = [item for part in parts for item in getattr(part, "__metadata__", ())]
    inside = [item for found in inside for item in getattr(found, "metadata", [found])]
    for item in [*field.metadata, *inside]:
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
