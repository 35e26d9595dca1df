"""What commands that read recordings ask about them: names, units, offsets, wiring, steps."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from runtime.commands.numbers import POSITIVE
from runtime.commands.terminal import working

if TYPE_CHECKING:
    from runtime.recorded.data import Recorded

#: Bytes of a file that takes seconds to read.
LONG = 100_000_000

Rename = Annotated[
    list[str] | None,
    typer.Option("--rename", metavar="THEIRS=OURS", help="A column's name here: Time=t, Ia=i_a; repeatable."),
]
Scale = Annotated[
    list[str] | None,
    typer.Option("--scale", metavar="NAME=FACTOR", help="i_alpha=1e-3, or a unit: theta=deg, t=ms; repeatable."),
]
Offset = Annotated[
    list[str] | None,
    typer.Option(
        "--offset", metavar="NAME=VALUE", help="Added to a column, in SI: i_a=-0.12, theta=90deg; repeatable."
    ),
]
Wiring = Annotated[
    str | None,
    typer.Option("--wiring", metavar="ORDER", help="Phases that the columns of a, b, c hold, and sign: bac, -abc."),
]
Begins = Annotated[
    bool, typer.Option("--begins", help="A row's voltages or duty cycles are of the interval that begins at its t.")
]
Resample = Annotated[
    bool, typer.Option("--resample", help="Data sampled faster than the drive steps: u averaged, i at the end.")
]
DcLink = Annotated[
    float | None,
    typer.Option("--dc-link", metavar="V", callback=POSITIVE, help="For duty cycles, where there is no column u_dc."),
]


def read(
    data: Path,
    rename: list[str] | None,
    scale: list[str] | None,
    corrections: tuple[list[str] | None, str | None, bool, float | None],
    onto: tuple[float, str] | None,
) -> Recorded:
    """Read a recording as the options say; ``onto``: resampled to a drive of that sample time (s) and name.

    ``corrections``: offsets, wiring, begins and dc link, as the options give them.
    """
    from runtime.recorded.data import Corrections, read_recorded
    from runtime.recorded.resample import resample

    offsets, wiring, begins, dc_link = corrections
    asked = Corrections(offsets or (), wiring, begins, dc_link)
    with _said(data):
        recorded = read_recorded(data, rename or (), scale or (), corrections=asked)
        return recorded if onto is None else resample(recorded, *onto)


@contextmanager
def _said(data: Path) -> Iterator[None]:
    """Say that a file is being read, where that takes its time."""
    if data.is_file() and data.stat().st_size > LONG:
        with working() as say:
            say(f"reading {data}")
            yield
    else:
        yield
