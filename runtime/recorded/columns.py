"""From the names and units of a file to the quantities that a filter knows."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from runtime.recorded.frames import FRAMES
from runtime.recorded.source import Source
from runtime.recorded.units import SI, find_unit
from runtime.system.errors import UserError
from runtime.system.values import checked_number

INPUTS = ("u_alpha", "u_beta", "i_alpha", "i_beta")
TRUTH = ("omega", "theta", "load_torque")
#: An angle as an encoder or a resolver gives it.
RESOLVER = ("cos_theta", "sin_theta")

QUANTITIES = {"t": "time", "omega": "speed", "theta": "angle", "load_torque": "torque"} | {
    name: "share" if name.startswith("duty") else quantity
    for kind, quantity in (("u", "voltage"), ("i", "current"))
    for name in (f"{kind}_alpha", f"{kind}_beta", *dict.fromkeys(n for names in FRAMES[kind] for n in names))
} | dict.fromkeys(RESOLVER, "share")  # fmt: skip

_PHASES = {"a": "a1u", "b": "b2v", "c": "c3w"}

#: Names of the columns elsewhere, letters and figures only; used to propose a --rename, never silently.
_ALIASES: dict[str, tuple[str, ...]] = {
    "t": ("t", "time", "times", "timems", "seconds", "zeit", "xaxis", "tout", "timestamp", "timestamps"),
    "omega": ("omega", "omegam", "speed", "wm", "w", "n", "rpm", "velestimate"),
    "theta": ("theta", "thetae", "angle", "position", "phase"),
    "load_torque": ("loadtorque", "torque", "tl", "tload", "load"),
    "u_dc": ("udc", "vdc", "vbus", "ubus", "dclink", "vbusvoltage", "busvoltage", "inputvoltage", "udclink", "vdclink"),
    **{
        f"duty_{phase}": tuple(f"{word}{p}" for word in ("duty", "d", "pwm") for p in _PHASES[phase]) for phase in "abc"
    },
    **{
        f"{kind}_{phase}": tuple(f"{word}{p}" for word in words for p in _PHASES[phase])
        for kind, words in (
            ("u", ("u", "v", "phasevoltage", "uphase", "vphase", "vph")),
            ("i", ("i", "iphase", "phasecurrent", "currentmeasph")),
        )
        for phase in "abc"
    },
    **{f"u_{line}": (f"u{line}", f"v{line}") for line in ("ab", "bc", "ca")},
    **{f"u_{axis}": (f"u{axis}", f"v{axis}", f"finalv{axis}") for axis in ("alpha", "beta")},
    **{f"i_{axis}": (f"i{axis}", f"{axis}current") for axis in ("alpha", "beta")},
}
_TURNED = re.compile(r"[iuv]?[dq](axis)?(current|voltage|measured|ref|setpoint)?")


def read_pairs(given: Sequence[str], option: str, example: str) -> list[tuple[str, str]]:
    """Split options of the form left=right; a name may hold an equals sign itself.

    Parameters
    ----------
    given : sequence of str
    option, example : str
        For the message.

    Raises
    ------
    UserError
    """
    for text in given:
        if not re.fullmatch(r"(?s).+=.+", text):
            raise UserError(f"{option} '{text}' is not of the form {example}.")
    return [(left.strip(), right.strip()) for left, _, right in (text.rpartition("=") for text in given)]


def own_columns(source: Source, renames: Sequence[str]) -> tuple[dict[str, int], list[str]]:
    """Find our columns in a file.

    Parameters
    ----------
    source : Source
    renames : sequence of "theirs=ours"

    Returns
    -------
    dict of str to int, list of str
        Our names and column numbers; what is to be told of them.

    Raises
    ------
    UserError
        A name that is not there, or there twice.
    """
    names = list(source.names)
    for theirs, ours in read_pairs(renames, "--rename", "theirs=ours"):
        if ours not in QUANTITIES:
            raise UserError(f"--rename {theirs}={ours}: '{ours}' is no column here; there are {', '.join(QUANTITIES)}.")
        found = source.find(theirs)
        if not found:
            raise UserError(f"--rename {theirs}={ours}: '{source.path}' has no '{theirs}'; it has {source.listed}.")
        if len(found) > 1:
            numbers = " or ".join(f"'#{k + 1}={ours}'" for k in found[:4])
            raise UserError(
                f"--rename {theirs}={ours}: '{source.path}' has '{theirs}' {len(found)} times; say {numbers}."
            )
        if ours in names and ours != theirs:
            names[names.index(ours)] = ""
        names[found[0]] = ours
    notes = []
    for k, name in enumerate(names):  # v for a voltage is as good a letter as u
        ours = f"u{name[1:]}"
        if name[:2] == "v_" and ours in QUANTITIES and ours not in names and names.count(name) == 1:
            names[k] = ours
            notes.append(f"{ours}: '{name}' is taken for it")
    doubled = [name for name in QUANTITIES if names.count(name) > 1]
    if doubled:
        raise UserError(f"'{source.path}' has the column '{doubled[0]}' {names.count(doubled[0])} times.")
    _check_brackets(source, names)
    return {name: k for k, name in enumerate(names) if name in QUANTITIES}, notes


def _check_brackets(source: Source, names: Sequence[str]) -> None:
    """Refuse a name of ours with something behind it that is no unit."""
    for name in names:
        match = re.fullmatch(r"(\w+)\s*[(\[](.*)[)\]]", name)
        if match and match[1] in QUANTITIES and match[1] not in names:
            _factor(match[1], match[2], source.path)


def factors(source: Source, columns: Mapping[str, int], scales: Sequence[str]) -> dict[str, float]:
    """Work out the factor of each column, from --scale or the unit beside its name.

    Parameters
    ----------
    source : Source
    columns : mapping of str to int
    scales : sequence of "name=factor"

    Raises
    ------
    UserError
        A name that is not there, or a factor that is none.
    """
    asked = {
        ours: _factor(ours, text)
        for ours, text in _asked(source, columns, scales, "--scale", "name=factor, such as i_alpha=1e-3 or theta=deg")
    }
    found = {}
    for name, k in columns.items():
        unit = source.units[k]
        found[name] = asked[name] if name in asked else _factor(name, unit, source.path) if unit else 1.0
    return found


def offsets(source: Source, columns: Mapping[str, int], given: Sequence[str]) -> dict[str, float]:
    """Work out what is added to a column, in SI.

    Parameters
    ----------
    source : Source
    columns : mapping of str to int
    given : sequence of "name=value"
        In SI, or with a unit: "theta=90deg".

    Raises
    ------
    UserError
    """
    found = {}
    for ours, text in _asked(source, columns, given, "--offset", "name=value, such as i_a=-0.12 or theta=90deg"):
        match = re.fullmatch(r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(\D.*)?", text)
        try:
            value = float(match[1]) if match else np.nan
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise UserError(f"--offset {ours}={text}: '{text}' is not a number such as -0.12 or 90deg.")
        checked_number(value, f"--offset {ours}={text}:")
        found[ours] = value * (_factor(ours, match[2].strip()) if match and match[2] else 1.0)
    return found


def _asked(
    source: Source, columns: Mapping[str, int], given: Sequence[str], option: str, example: str
) -> list[tuple[str, str]]:
    """Our name and what was asked of it."""
    asked = []
    for name, text in read_pairs(given, option, example):
        numbers = source.find(name)
        ours = name if name in columns else next((own for own, k in columns.items() if k in numbers), None)
        if ours is None:
            why = (
                f"'{name}' is not in use, --rename it"
                if numbers
                else f"'{source.path}' has no '{name}'; it has {source.listed}"
            )
            raise UserError(f"{option} {name}={text}: {why}.")
        asked.append((ours, text))
    return asked


def _factor(name: str, text: str, path: Path | None = None) -> float:
    """A number or a unit as a factor; ``path`` for a unit that stands in a file's header."""
    quantity = QUANTITIES[name]
    unit = find_unit(text)
    if unit is not None and unit.quantity == quantity:
        return unit.factor
    where = f"--scale {name}={text}" if path is None else f"'{path}': the column for {name} is in '{text[:40]}'"
    if unit is not None:
        remedy = f"; if it is a probe's, give its factor: --scale {name}={SI[quantity]}_PER_{text}" if path else ""
        raise UserError(f"{where}: that is a unit of {unit.quantity}, {name} is in {SI[quantity]}{remedy}.")
    try:
        factor = float(text)
    except ValueError:
        factor = np.nan
    if not np.isfinite(factor) or factor == 0.0:
        raise UserError(f"{where}: neither a unit of {quantity} nor a number; say its factor with --scale {name}=...")
    return factor


def find_frame(source: Source, columns: Mapping[str, int], kind: str, need_time: bool) -> tuple[str, ...]:
    """Choose the columns that voltage or current is made of.

    Parameters
    ----------
    source : Source
    columns : mapping of str to int
    kind : {"u", "i"}
    need_time : bool

    Raises
    ------
    UserError
        Naming what is missing, and what it may be called in the file.
    """
    direct = (f"{kind}_alpha", f"{kind}_beta")
    for names in (direct, *FRAMES[kind]):
        if all(name in columns for name in names):
            return names
    needed = (["t"] if need_time else []) + list(INPUTS)
    raise UserError(missing(source, columns, [name for name in needed if name not in columns]))


def missing(source: Source, columns: Mapping[str, int], lacking: Sequence[str]) -> str:
    """Say which columns a file lacks, and how those it has may be meant.

    Parameters
    ----------
    source : Source
    columns : mapping of str to int
    lacking : sequence of str
    """
    if source.hint:
        return source.hint
    taken = {source.names[k] for k in columns.values() if k >= 0}
    proposals = []
    for ours, aliases in _ALIASES.items():
        near = [name for name in source.names if name and name not in taken and _letters(name) in aliases]
        if near and ours not in columns:
            proposals.append(f"--rename {quoted(near[0])}={ours}")
            taken.add(near[0])
    lacks = f"'{source.path}' lacks the column {', '.join(lacking)}; it has {source.listed}."
    turned = [name for name in source.names if len(_letters(name)) > 1 and _TURNED.fullmatch(_letters(name))]
    if proposals:
        return f"{lacks} Did you mean {' '.join(proposals[:12])}?"
    if turned:
        return f"{lacks} '{turned[0][:40]}' lacks the angle it was turned by: record phase currents and voltages."
    frames = (
        "Currents may also be two of i_a, i_b, i_c, voltages u_a, u_b, u_c, two of u_ab, u_bc, u_ca, "
        "or duty_a, duty_b, duty_c and u_dc."
    )
    return f"{lacks} Name them: --rename theirs=ours. {frames}"


def _letters(name: str) -> str:
    """The last part of a dotted path, its letters and figures."""
    return re.sub(r"[^a-z0-9]", "", name.lower().rpartition(".")[2])


def quoted(name: str) -> str:
    """Quote a name for a shell, where it needs that.

    Parameters
    ----------
    name : str
    """
    return f"'{name}'" if re.search(r"[\s;&|()<>$*?#\[\]]", name) else name
