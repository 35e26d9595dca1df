"""The recorded-data format, the one place that knows it.

Columns: ``t`` s; ``u_alpha``, ``u_beta`` V, mean over the interval ending at t; ``i_alpha``, ``i_beta`` A at t. Truth,
where it is known: ``omega`` rad/s mechanical, ``theta`` rad electrical, ``load_torque`` N m. As .npz, or as .csv with a
header. Files from elsewhere are renamed, scaled and brought to the alpha-beta frame while they are read.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.recorded.text import read_csv
from runtime.recorded.units import SI, find_unit
from runtime.system.errors import UserError
from runtime.system.files import whole_file

Array = NDArray[Any]

INPUTS = ("u_alpha", "u_beta", "i_alpha", "i_beta")
TRUTH = ("omega", "theta", "load_torque")
SUFFIXES = (".npz", ".csv")

_SQRT3 = np.sqrt(3.0)

#: Other quantities a pair (alpha, beta) can be made of, the best first: amplitude-invariant Clarke transforms.
FRAMES: dict[str, dict[tuple[str, ...], Callable[..., tuple[Array, Array]]]] = {
    "i": {
        ("i_a", "i_b", "i_c"): lambda a, b, c: ((2 * a - b - c) / 3, (b - c) / _SQRT3),
        ("i_a", "i_b"): lambda a, b: (a, (a + 2 * b) / _SQRT3),
    },
    "u": {
        ("u_a", "u_b", "u_c"): lambda a, b, c: ((2 * a - b - c) / 3, (b - c) / _SQRT3),
        ("u_ab", "u_bc"): lambda ab, bc: ((2 * ab + bc) / 3, bc / _SQRT3),
    },
}

QUANTITIES = {"t": "time", "omega": "speed", "theta": "angle", "load_torque": "torque"} | {
    name: quantity
    for kind, quantity in (("u", "voltage"), ("i", "current"))
    for name in (f"{kind}_alpha", f"{kind}_beta", *dict.fromkeys(n for names in FRAMES[kind] for n in names))
}

#: Names of the columns elsewhere, letters and figures only; used to propose a --rename, never silently.
_ALIASES = {
    "t": ("t", "time", "times", "seconds", "zeit"),
    "omega": ("omega", "omegam", "speed", "wm", "w", "n", "rpm"),
    "theta": ("theta", "thetae", "angle", "position"),
    "load_torque": ("loadtorque", "torque", "tl", "tload", "load"),
} | {
    name: tuple(letter + name[1:].replace("_", "") for letter in ({"u": "uv", "i": "i"}[name[0]]))
    for name in QUANTITIES
    if name[0] in "ui" and name[1] == "_"
}


@dataclass(frozen=True)
class Recorded:
    """Recorded data of N samples.

    t (N,) s, u (N, 2) V, y (N, 2) A; ``truth`` has what is known of
    omega rad/s, theta rad, load_torque N m. ``notes`` say what was converted.
    """

    path: Path
    t: Array
    u: Array
    y: Array
    truth: dict[str, Array]
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Source:
    """A file's columns before they are understood."""

    path: Path
    names: tuple[str, ...]
    units: tuple[str, ...]
    load: Callable[[Sequence[int]], list[Array]]


def read_recorded(
    path: Path, renames: Sequence[str] = (), scales: Sequence[str] = (), need_time: bool = True
) -> Recorded:
    """Read .npz or .csv.

    Parameters
    ----------
    renames : sequence of "theirs=ours"
    scales : sequence of "name=factor"
        The factor may be a unit, such as ``theta=deg``; it replaces the one beside the column's name.
    need_time : bool
        Without, rows alone count and ``t`` is empty.

    Raises
    ------
    UserError
        If the file cannot be read, lacks a column, or a column is empty or not numbers.
    """
    source = _npz(path) if path.suffix == ".npz" else _csv(path)
    columns = _ours(source, renames)
    factors = _factors(source, columns, scales)
    frames = {kind: _frame(source, columns, kind, need_time) for kind in ("u", "i")}
    if need_time and "t" not in columns:
        raise UserError(_missing(source, columns, ["t"]))
    wanted = ["t"] if need_time else []
    wanted += [name for names in frames.values() for name in names] + [name for name in TRUTH if name in columns]
    values = dict(zip(wanted, source.load([columns[name] for name in wanted]), strict=True))
    notes = []
    for name in wanted:
        if factors[name] != 1.0:
            notes.append(f"{name}: '{source.names[columns[name]]}' times {factors[name]:.6g}")
            values[name] = values[name] * factors[name]
    pairs = []
    for kind, names in frames.items():
        pairs.append(np.column_stack(_to_alpha_beta(kind, names, [values[name] for name in names])))
        if len(names) != 2 or names[0] != f"{kind}_alpha":
            notes.append(f"{kind}_alpha, {kind}_beta: by Clarke of {', '.join(names)}")
    if not len(pairs[0]):
        raise UserError(f"'{path}' holds no samples.")
    truth = {name: values[name] for name in TRUTH if name in values}
    return Recorded(path, values.get("t", np.empty(0)), pairs[0], pairs[1], truth, notes)


def write_recorded(path: Path, columns: Mapping[str, Array]) -> None:
    """Write recorded data as .npz, or as .csv with a header, by the path's suffix.

    Parameters
    ----------
    path : Path
    columns : mapping of str to ndarray, (N,)
        By the names of the data format, in SI units.
    """
    check_suffix(path)
    if path.suffix == ".npz":
        with whole_file(path) as file:
            np.savez(file, allow_pickle=False, **columns)
    else:
        table = np.column_stack(list(columns.values()))
        with whole_file(path) as file:
            np.savetxt(file, table, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")


def check_suffix(path: Path) -> None:
    """Refuse a path that is neither .npz nor .csv.

    Parameters
    ----------
    path : Path

    Raises
    ------
    UserError
        Naming the suffixes that are known.
    """
    if path.suffix not in SUFFIXES:
        raise UserError(f"'{path}': recorded data is .npz or .csv.")


def _npz(path: Path) -> Source:
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: np.asarray(file[name]) for name in file.files}
    except (OSError, ValueError, AttributeError, EOFError) as error:
        raise UserError(f"'{path}' cannot be read as recorded data: {error}") from None
    except Exception as error:  # zipfile and zlib have their own, for a damaged archive
        raise UserError(f"'{path}' cannot be read as recorded data: {error}") from None

    def load(chosen: Sequence[int]) -> list[Array]:
        names = [list(arrays)[k] for k in chosen]
        for name in names:
            if arrays[name].ndim != 1 or arrays[name].dtype.kind not in "fiub":
                shape, kind = arrays[name].shape, arrays[name].dtype
                raise UserError(f"'{path}': {name} has shape {shape} and type {kind}; a column is numbers (N,).")
        lengths = {name: len(arrays[name]) for name in names}
        if len(set(lengths.values())) > 1:
            said = ", ".join(f"{name} {length}" for name, length in lengths.items())
            raise UserError(f"'{path}': the columns have different lengths: {said}.")
        return [arrays[name].astype(float) for name in names]

    return Source(path, tuple(arrays), ("",) * len(arrays), load)


def _csv(path: Path) -> Source:
    table = read_csv(path)
    return Source(path, table.names, table.units, table.columns)


def _pairs(given: Sequence[str], option: str, example: str) -> list[tuple[str, str]]:
    for text in given:
        if not re.fullmatch(r".+=.+", text):
            raise UserError(f"{option} '{text}' is not of the form {example}.")
    return [(left.strip(), right.strip()) for left, _, right in (text.rpartition("=") for text in given)]


def _ours(source: Source, renames: Sequence[str]) -> dict[str, int]:
    """Our names -> column numbers."""
    names = list(source.names)
    for theirs, ours in _pairs(renames, "--rename", "theirs=ours"):
        if ours not in QUANTITIES:
            raise UserError(f"--rename {theirs}={ours}: '{ours}' is no column here; there are {', '.join(QUANTITIES)}.")
        if theirs not in source.names:
            raise UserError(f"--rename {theirs}={ours}: '{source.path}' has no '{theirs}'; it has {_listed(source)}.")
        if ours in names and ours != theirs:
            names[names.index(ours)] = ""
        names[source.names.index(theirs)] = ours
    doubled = [name for name in QUANTITIES if names.count(name) > 1]
    if doubled:
        raise UserError(f"'{source.path}' has the column '{doubled[0]}' {names.count(doubled[0])} times.")
    return {name: k for k, name in enumerate(names) if name in QUANTITIES}


def _factors(source: Source, columns: Mapping[str, int], scales: Sequence[str]) -> dict[str, float]:
    """The factor of each column, from --scale or the unit beside its name."""
    asked = {}
    for name, text in _pairs(scales, "--scale", "name=factor, such as i_alpha=1e-3 or theta=deg"):
        ours = next((own for own, k in columns.items() if name in {own, source.names[k]}), None)
        if ours is None:
            raise UserError(f"--scale {name}={text}: '{source.path}' has no '{name}'; it has {_listed(source)}.")
        asked[ours] = _factor(ours, text)
    factors = {}
    for name, k in columns.items():
        unit = source.units[k]
        factors[name] = asked[name] if name in asked else _factor(name, unit, source.path) if unit else 1.0
    return factors


def _factor(name: str, text: str, path: Path | None = None) -> float:
    """A number or a unit as a factor; ``path`` for a unit that stands in a file's header."""
    quantity = QUANTITIES[name]
    unit = find_unit(text)
    if unit is not None and unit.quantity == quantity:
        return unit.factor
    where = f"--scale {name}={text}" if path is None else f"'{path}': the column for {name} is in '{text}'"
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


def _frame(source: Source, columns: Mapping[str, int], kind: str, need_time: bool) -> tuple[str, ...]:
    """The columns that voltage or current is made of."""
    direct = (f"{kind}_alpha", f"{kind}_beta")
    for names in (direct, *FRAMES[kind]):
        if all(name in columns for name in names):
            return names
    needed = (["t"] if need_time else []) + list(INPUTS)
    raise UserError(_missing(source, columns, [name for name in needed if name not in columns]))


def _to_alpha_beta(kind: str, names: tuple[str, ...], values: list[Array]) -> tuple[Array, Array]:
    transform = FRAMES[kind].get(names)
    return transform(*values) if transform is not None else (values[0], values[1])


def _missing(source: Source, columns: Mapping[str, int], missing: Sequence[str]) -> str:
    taken = {source.names[k] for k in columns.values()}
    proposals = []
    for ours, aliases in _ALIASES.items():
        near = [n for n in source.names if n not in taken and re.sub(r"[^a-z0-9]", "", n.lower()) in aliases]
        if near and ours not in columns:
            proposals.append(f"--rename {_quoted(near[0])}={ours}")
    lacks = f"'{source.path}' lacks the column {', '.join(missing)}; it has {_listed(source)}."
    frames = " Currents may also be i_a, i_b[, i_c], voltages u_a, u_b, u_c or u_ab, u_bc."
    return lacks + (
        f" Did you mean {' '.join(proposals)}?" if proposals else f" Name them: --rename theirs=ours.{frames}"
    )


def _quoted(name: str) -> str:
    return f"'{name}'" if re.search(r"\s", name) else name


def _listed(source: Source) -> str:
    names = [name for name in source.names if name]
    return ", ".join(names[:20]) + (", ..." if len(names) > 20 else "") if names else "no column"
