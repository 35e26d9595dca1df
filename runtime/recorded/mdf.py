"""ASAM's MDF, version 4 and older, by asammdf: a channel a column; the raster of the chosen channels is ``t``."""

from __future__ import annotations

import gc
import logging
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from runtime.recorded.source import Array, Source, check_lengths, checked_column, unreadable
from runtime.system.errors import UserError

#: What stands for "no unit" in measurement files.
_NO_UNIT = {"", "-", "1", "none", "unitless"}


def read_mdf(path: Path) -> Source:
    """Read the channels' names and units.

    Parameters
    ----------
    path : Path

    Raises
    ------
    UserError
        asammdf is missing, or the file is damaged.
    """
    try:
        from asammdf import MDF
    except ImportError:
        raise UserError("an MDF file needs asammdf: pip install 'pmsm-ickf[mdf]'.") from None
    channels = _read(path, MDF, _channels)
    places = [place for _, _, place in channels]
    names = [name for name, _, _ in channels]
    units = ["" if unit.strip().lower() in _NO_UNIT else unit for _, unit, _ in channels]
    own_time = "t" in names
    names, units = (names, units) if own_time else ([*names, "t"], [*units, "s"])
    master = None if own_time else len(places)

    def load(chosen: Sequence[int]) -> list[Array]:
        numbers = [k for k in chosen if k != master]
        read = _read(path, MDF, lambda file: [_signal(file, *places[k]) for k in numbers])
        signals = dict(zip(numbers, read, strict=True))
        rasters = [(names[k], times) for k, (times, _) in signals.items()]
        _check_rasters(path, rasters)
        columns = {k: checked_column(path, names[k], values) for k, (_, values) in signals.items()}
        if master in chosen:
            columns[len(places)] = rasters[0][1] if rasters else np.empty(0)
        check_lengths(path, [(names[k], values) for k, values in columns.items()])
        return [columns[k] for k in chosen]

    return Source(path, tuple(names), tuple(units), load, tuple(names))


def _read(path: Path, mdf: Any, take: Callable[[Any], list[Any]]) -> list[Any]:
    """What is taken of a file. asammdf logs, and complains once more of a damaged file when it lets go of it."""
    hook, logger = sys.unraisablehook, logging.getLogger("asammdf")
    sys.unraisablehook, disabled, logger.disabled = lambda _: None, logger.disabled, True
    try:
        with mdf(path) as file:
            return take(file)
    except Exception as error:  # asammdf has many, and lets those of struct through
        refusal = unreadable(path, error)
    finally:
        gc.collect()
        sys.unraisablehook, logger.disabled = hook, disabled
    raise refusal


def _channels(file: Any) -> list[tuple[str, str, tuple[int, int]]]:
    """Name, unit and place (group, channel) of all that is no master."""
    masters = file.masters_db
    return [
        (channel.name, file.get_channel_unit(group=g, index=k) or "", (g, k))
        for g, group in enumerate(file.groups)
        for k, channel in enumerate(group.channels)
        if masters.get(g) != k
    ]


def _signal(file: Any, group: int, index: int) -> tuple[Array, Array]:
    """Times (s) and values of a channel; a sample that the file calls invalid is NaN."""
    signal = file.get(group=group, index=index, ignore_invalidation_bits=True)
    values = np.asarray(signal.samples)
    bits = signal.invalidation_bits
    if bits is not None and np.any(bits):
        values = np.where(np.asarray(bits, dtype=bool), np.nan, values)
    return np.asarray(signal.timestamps, dtype=float), values


def _check_rasters(path: Path, rasters: Sequence[tuple[str, Array]]) -> None:
    """All channels at the same times: nothing is interpolated here."""
    for name, times in rasters[1:]:
        if not np.array_equal(times, rasters[0][1]):
            raise UserError(
                f"'{path}': '{name}' and '{rasters[0][0]}' have rasters of their own ({len(times):,} and "
                f"{len(rasters[0][1]):,} samples): choose channels of one raster, or bring them to one before."
            )
