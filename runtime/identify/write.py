"""What was found, into a facts file or a drive file: an existing one is edited and keeps its comments."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from model.drives.load import parse_drive
from model.schema import DriveError
from runtime.design.facts import Facts, parse_facts
from runtime.design.known import stated
from runtime.design.write import NOW, facts_text
from runtime.identify.intervals import Estimate
from runtime.identify.subject import is_facts
from runtime.recorded.units import RPM
from runtime.system.errors import UserError

#: Tolerances are written no smaller: a motor warms up, and a recording is of one day.
LEAST_TOLERANCE = 0.01
#: The tolerance keys of the data.
TOLERANCE = {"R": "stator_resistance", "L": "inductance", "L_d": "inductance", "L_q": "inductance"}
TOLERANCE |= {"psi_m": "magnet_flux", "J": "inertia"}


@dataclass(frozen=True)
class Findings:
    """What is to be written: the subject's name, its facts as stated and as found, and every estimate."""

    name: str
    stated: Facts
    facts: Facts
    estimates: Sequence[Estimate]


def check_write(path: Path) -> None:
    """Refuse, before the work, what could not be written after it.

    Parameters
    ----------
    path : Path

    Raises
    ------
    UserError
        Not a TOML file's name, no such folder, or an existing file that cannot be edited.
    """
    if path.suffix != ".toml":
        raise UserError(f"--write '{path}': a facts file or drive file ends in .toml.")
    if not path.parent.is_dir():
        raise UserError(f"--write '{path}': there is no folder '{path.parent}'.")
    if path.exists():
        _document(path)


def written_text(found: Findings, path: Path) -> str:
    """The text of the file: a new facts file, or the existing facts or drive file edited.

    Parameters
    ----------
    found : Findings
    path : Path

    Raises
    ------
    UserError
        The existing file is another motor's, or would be refused with what was found.
    """
    if not path.exists():
        return facts_text(facts_tables(found.facts))
    document = _document(path)
    own = found.name
    if document.get("name") != own:
        raise UserError(f"'{path}' is of '{document.get('name')}', what was found of '{own}'. Choose another --write.")
    if is_facts(path):
        _edit_facts(document, found)
    else:
        _edit_drive(document, found)
    import tomlkit

    text = str(tomlkit.dumps(document))
    try:
        data = tomllib.loads(text)
        if is_facts(path):
            parse_facts(data, path.name)
        elif ".py:" not in str(data.get("model", {}).get("machine", "")):
            parse_drive(data, path.name)
    except DriveError as error:
        raise UserError(f"with what was found '{path}' would be refused: {error}") from None
    return text


def _document(path: Path) -> Any:
    try:
        import tomlkit
        from tomlkit.exceptions import TOMLKitError
    except ImportError:
        raise UserError(
            "editing an existing file needs tomlkit: pip install 'pmsm-ickf[design]'. A new --write needs nothing."
        ) from None
    try:
        return tomlkit.parse(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise UserError(f"'{path}' cannot be read: {error.strerror}.") from None
    except (TOMLKitError, UnicodeDecodeError) as error:
        raise UserError(f"'{path}' is not valid TOML: {error}") from None


def facts_tables(f: Facts) -> dict[str, Any]:
    """Facts as the tables of a facts file, in SI.

    Parameters
    ----------
    f : Facts
    """
    motor = {"stator_resistance": stated(f.R), "inductance_d": stated(f.L_d), "inductance_q": stated(f.L_q)}
    motor |= {"magnet_flux": stated(f.psi_m), "pole_pairs": f.p, "inertia": stated(f.J), "friction": f.D}
    widths = {"stator_resistance": f.d_R, "inductance": f.d_L, "magnet_flux": f.d_psi, "inertia": f.d_J}
    return {
        "name": f.name,
        "motor": motor,
        "rated": {"speed": stated(f.speed), "torque": stated(f.torque), "max_current": f.max_current},
        "tolerance": {key: _tolerance(width) for key, width in widths.items()},
        "inverter": {"dc_link": f.dc_link, "sample_time": f.T, "dead_time": stated(f.dead_time)},
        "sensor": {"range": f.range, "bits": f.bits, "noise": stated(f.noise)},
        "start": {"angle": stated(math.degrees(f.angle))},
        "load": {"step_every": f.step_every},
    }


def _tolerance(width: float) -> float:
    return float(f"{min(max(width, LEAST_TOLERANCE), 0.9):.2g}")


def _told(found: Findings) -> dict[str, Estimate]:
    return {e.datum.word: e for e in found.estimates if e.told}


def _set(table: Any, key: str, value: float, estimate: Estimate) -> None:
    """A number with its interval beside it; the comment that stood there is kept."""
    said = table[key].trivia.comment.lstrip("# ").partition(NOW)[0] if key in table else ""
    table[key] = float(f"{value:.6g}")
    scale = value / estimate.value if estimate.value else 1.0
    reason = f"identified, 95 %: {estimate.low * scale:.5g} .. {estimate.high * scale:.5g}"
    table[key].comment(f"{said}{NOW}{reason}" if said else reason)


def _edit_widths(document: Any, told: Mapping[str, Estimate], keys: Mapping[str, str]) -> None:
    import tomlkit

    widths: dict[str, float] = {}
    for word, estimate in told.items():
        if word in keys:
            widths[keys[word]] = max(widths.get(keys[word], 0.0), estimate.width)
    if widths:
        table = document.setdefault("tolerance", tomlkit.table())
        for key, width in widths.items():
            table[key] = _tolerance(width)


def _edit_facts(document: Any, found: Findings) -> None:
    """Each datum in the way in which the file states it."""
    told, motor, pairs = _told(found), document["motor"], found.stated.p
    if "R" in told:
        e = told["R"]
        key, factor = ("line_resistance", 2) if "line_resistance" in motor else ("stator_resistance", 1)
        _set(motor, key, factor * e.value, e)
    if "L" in told and "line_inductance" in motor:
        _set(motor, "line_inductance", 2 * told["L"].value, told["L"])
    else:
        _edit_inductances(motor, told, found.facts)
    if "psi_m" in told:
        e = told["psi_m"]
        ways = {
            "ke_v_per_krpm": lambda psi: psi * (pairs * 1000 / RPM) / (2 / 3) ** 0.5,
            "kv_rpm_per_v": lambda psi: RPM / (3**0.5 * pairs * psi),
            "magnet_flux": lambda psi: psi,
        }
        key = next(key for key in ways if key in motor)
        low, high = sorted((ways[key](e.low), ways[key](e.high)))
        _set(motor, key, ways[key](e.value), Estimate(e.datum, e.guess, ways[key](e.value), low, high, True))
    for word, key in (("J", "inertia"), ("D", "friction")):
        if word in told:
            _set(motor, key, told[word].value, told[word])
    if "V_dead" in told:
        _set_dead_time(document["inverter"], told["V_dead"], found, 1 / found.stated.T)
    _edit_widths(document, told, TOLERANCE)


def _edit_inductances(motor: Any, told: Mapping[str, Estimate], facts: Facts) -> None:
    changed = [word for word in ("L", "L_d", "L_q") if word in told]
    if not changed:
        return
    motor.pop("line_inductance", None)
    for key, words, value in (("inductance_d", ("L", "L_d"), facts.L_d), ("inductance_q", ("L", "L_q"), facts.L_q)):
        estimate = next((told[word] for word in words if word in told), None)
        if estimate is not None:
            _set(motor, key, estimate.value, estimate)
        elif key not in motor:
            motor[key] = value


def _set_dead_time(table: Any, e: Estimate, found: Findings, switching: float) -> None:
    """The dead time that takes as much at a switching frequency; what switches drop is in it, or was taken off."""
    f = found.stated
    per_volt = 1 / (f.dc_link * switching)
    if e.high <= 0 or (e.low <= 0 and "dead_time" not in table):
        return
    value, low, high = (max(v, 0.0) * per_volt for v in (e.value, e.low, e.high))
    _set(table, "dead_time", min(value, 0.2 * f.T), Estimate(e.datum, e.guess, value, low, high, True))


def _edit_drive(document: Any, found: Findings) -> None:
    import tomlkit

    told, motor = _told(found), document["motor"]
    for word, keys in (("R", ("stator_resistance",)), ("L", ("inductance_d", "inductance_q"))):
        for key in keys:
            if word in told:
                _set(motor, key, told[word].value, told[word])
    singles = {"L_d": "inductance_d", "L_q": "inductance_q", "psi_m": "magnet_flux", "J": "inertia", "D": "friction"}
    for word, key in singles.items():
        if word in told:
            _set(motor, key, told[word].value, told[word])
    if "V_dead" in told:
        drop = float(document.get("inverter", {}).get("switch_drop", 0.0))
        e = told["V_dead"]
        if "inverter" in document or e.low > 0:
            table = document.setdefault("inverter", tomlkit.table())
            rest = Estimate(e.datum, e.guess, e.value - drop, e.low - drop, e.high - drop, True)
            _set_dead_time(table, rest, found, float(table.get("switching_frequency", 1 / found.stated.T)))
    _edit_widths(document, told, {word: key for word, key in TOLERANCE.items() if word != "J"})
