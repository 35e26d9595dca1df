"""The recorded-data format, the one place that knows it.

Columns: ``t`` s; ``u_alpha``, ``u_beta`` V, mean over the interval ending at t; ``i_alpha``, ``i_beta`` A at t. Truth,
where it is known: ``omega`` rad/s mechanical, ``theta`` rad electrical, ``load_torque`` N m. Written as .npz, or as
.csv with a header. Files from elsewhere (``formats.py``) are renamed, scaled and brought to the alpha-beta frame while
they are read; nothing is mended that nobody asked for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.recorded.columns import RESOLVER, TRUTH, factors, find_frame, missing, offsets, own_columns
from runtime.recorded.formats import read_source
from runtime.recorded.frames import DUTY, FRAMES, WIRINGS, rewired
from runtime.recorded.rest import offset_notes
from runtime.recorded.source import Source
from runtime.system.errors import UserError
from runtime.system.files import whole_file

Array = NDArray[Any]

#: What recorded data can be written as.
SUFFIXES = (".npz", ".csv")
#: The largest duty cycle that is rounded from 1.
DUTY_REACH = 1.01


@dataclass(frozen=True)
class Recorded:
    """Recorded data of N samples.

    t (N,) s, u (N, 2) V, y (N, 2) A; ``truth`` has what is known of
    omega rad/s, theta rad, load_torque N m. ``notes`` say what was converted; ``applied`` has
    for each column that was read what the file's numbers were multiplied with, and what was added then.
    """

    path: Path
    t: Array
    u: Array
    y: Array
    truth: dict[str, Array]
    notes: list[str] = field(default_factory=list)
    applied: dict[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Corrections:
    """What is asked for beyond names and units.

    ``offsets``: "name=value", added to a column in SI; ``wiring``: order and sign of the current sensors, such as "bac"
    or "-abc"; ``begins``: voltages and duty cycles of a row are those of the interval that begins at its t; ``dc_link``
    V, where the file has no u_dc.
    """

    offsets: Sequence[str] = ()
    wiring: str | None = None
    begins: bool = False
    dc_link: float | None = None


def read_recorded(
    path: Path,
    renames: Sequence[str] = (),
    scales: Sequence[str] = (),
    need_time: bool = True,
    corrections: Corrections = Corrections(),
) -> Recorded:
    """Read a recording of any known format.

    Parameters
    ----------
    path : Path
    renames : sequence of "theirs=ours"
    scales : sequence of "name=factor"
        The factor may be a unit, such as ``theta=deg``; it replaces the one beside the column's name.
    need_time : bool
        Without, rows alone count and ``t`` is empty.
    corrections : Corrections

    Raises
    ------
    UserError
        If the file cannot be read, lacks a column, or a column is empty or not numbers.
    """
    _check(corrections)
    source = read_source(path)
    columns, notes = own_columns(source, renames)
    factor = factors(source, columns, scales)
    offset = offsets(source, columns, corrections.offsets)
    if corrections.dc_link is not None:
        columns.setdefault("u_dc", -1)
    frames = {kind: find_frame(source, columns, kind, need_time) for kind in ("u", "i")}
    if need_time and "t" not in columns:
        raise UserError(missing(source, columns, ["t"]))
    wanted = _wanted(columns, frames, need_time)
    values = dict(zip(wanted, source.load([columns[name] for name in wanted]), strict=True))
    notes += source.notes
    with np.errstate(over="ignore", invalid="ignore"):  # what is beyond a number is rejected by the filter
        notes += _scaled(source, columns, values, factor, offset)
        if "duty_a" in frames["u"]:
            _check_duty(source, values, asked=any(factor[name] != 1.0 for name in DUTY))
            if "u_dc" not in values:
                values["u_dc"] = np.full(len(values["duty_a"]), corrections.dc_link)
        u = _pair(frames["u"], values, "u", notes)
        notes += offset_notes(u, {name: values[name] for name in frames["i"]})
        y = _pair(frames["i"], values, "i", notes)
        if corrections.wiring is not None:
            y = rewired(y, corrections.wiring)
        truth = _truth(values)
    if not len(u):
        raise UserError(f"'{path}' holds no samples.")
    if corrections.wiring is not None:
        notes.append(f"i_alpha, i_beta: current sensors wired as {corrections.wiring}")
    applied = {name: (factor[name], offset.get(name, 0.0)) for name in wanted}
    recorded = Recorded(path, values.get("t", np.empty(0)), u, y, truth, notes, applied)
    return _one_row_later(recorded) if corrections.begins else recorded


def _check(corrections: Corrections) -> None:
    if corrections.wiring is not None and corrections.wiring not in WIRINGS:
        raise UserError(f"--wiring '{corrections.wiring}' is none of {', '.join(WIRINGS)}.")
    if corrections.dc_link is not None and not 0.0 < corrections.dc_link < 1e6:
        raise UserError(f"--dc-link {corrections.dc_link:g} is no voltage of a dc link, 0 .. 1e6 V.")


def _wanted(columns: Mapping[str, int], frames: Mapping[str, Sequence[str]], need_time: bool) -> list[str]:
    wanted = ["t"] if need_time else []
    wanted += [name for names in frames.values() for name in names if columns[name] >= 0]
    wanted += [name for name in TRUTH if name in columns]
    if "theta" not in columns and all(name in columns for name in RESOLVER):
        wanted += RESOLVER
    return wanted


def _scaled(
    source: Source,
    columns: Mapping[str, int],
    values: dict[str, Array],
    factor: Mapping[str, float],
    offset: Mapping[str, float],
) -> list[str]:
    """Bring values to SI, in place; what was done."""
    notes = []
    for name in values:
        if factor[name] != 1.0:
            notes.append(f"{name}: '{source.names[columns[name]]}' times {factor[name]:.6g}")
            values[name] = values[name] * factor[name]
        if name in offset:
            notes.append(f"{name}: {offset[name]:+.6g} added")
            values[name] = values[name] + offset[name]
    return notes


def _check_duty(source: Source, values: Mapping[str, Array], asked: bool) -> None:
    """Duty cycles are shares of 1: anything else is refused with the factor that it looks like.

    ``asked``: somebody said the factor, so that -0.5 .. 0.5 is as good; the middle is in all three and cancels.
    """
    duty = np.concatenate([values[name] for name in DUTY])
    duty = duty[np.isfinite(duty)]
    low, high = (float(duty.min()), float(duty.max())) if len(duty) else (0.0, 0.0)
    if (-DUTY_REACH if asked else 1.0 - DUTY_REACH) <= low and high <= DUTY_REACH:
        return
    if low >= -DUTY_REACH and high <= DUTY_REACH:
        factor, what = "0.5", "a modulation of -1 .. 1"
    elif low >= 0.0 and high <= 100.0 * DUTY_REACH:
        factor, what = "%", "per cent"
    else:
        factor, what = "1/COUNTS", "counts of a timer"
    said = " ".join(f"--scale {name}={factor}" for name in DUTY)
    raise UserError(
        f"'{source.path}': duty cycles reach from {low:.4g} to {high:.4g}, not from 0 to 1. If they are {what}: {said}."
    )


def _pair(names: Sequence[str], values: dict[str, Array], kind: str, notes: list[str]) -> Array:
    """(N, 2) alpha and beta; the columns it is made of are let go."""
    columns = [values.pop(name) for name in names]
    transform = FRAMES[kind].get(tuple(names))
    if transform is None:
        return np.column_stack(columns)
    notes.append(f"{kind}_alpha, {kind}_beta: by Clarke of {', '.join(names)}")
    if "u_dc" in names:
        notes.append("a duty cycle is taken for that of the interval that ends at its t; else say --begins")
    return np.column_stack(transform(*columns))


def _truth(values: Mapping[str, Array]) -> dict[str, Array]:
    truth = {name: values[name] for name in TRUTH if name in values}
    if RESOLVER[0] in values:
        truth["theta"] = np.arctan2(values[RESOLVER[1]], values[RESOLVER[0]])
    return truth


def _one_row_later(recorded: Recorded) -> Recorded:
    """Voltages of the interval that begins at a row, on the row at which it ends; the first row has none."""
    if len(recorded.u) < 2:
        raise UserError(f"'{recorded.path}': of one row there is no voltage over the interval before it.")
    truth = {name: values[1:] for name, values in recorded.truth.items()}
    notes = [*recorded.notes, "u_alpha, u_beta: of the interval that begins at t, moved to the row that ends it"]
    return replace(recorded, t=recorded.t[1:], u=recorded.u[:-1], y=recorded.y[1:], truth=truth, notes=notes)


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
    """Refuse a path to write to that is neither .npz nor .csv.

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
