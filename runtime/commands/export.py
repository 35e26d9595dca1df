"""The commands ``export fmu``, ``sfunction``, ``plecs`` and ``a2l``: a drive for other people's tools."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from runtime.commands.paths import writes_file
from runtime.commands.terminal import say
from runtime.commands.words import DRIVE
from runtime.system.files import whole_file, write_text

if TYPE_CHECKING:
    from runtime.estimator.folder import GeneratedFolder

app = typer.Typer(
    name="export",
    help="For other tools: FMU, Simulink S-function, PLECS C-Script, calibration (.a2l).",
    no_args_is_help=True,
)


class Part(StrEnum):
    """What is exported."""

    filter = "filter"
    drive = "drive"
    motor = "motor"


class DataModel(StrEnum):
    """Sizes on the processor."""

    c28x = "c28x"
    ilp32 = "ilp32"


Word = Annotated[str, typer.Argument(metavar="DRIVE", help=DRIVE)]
Out = Annotated[Path, writes_file("The file to write.", show_default=False)]
Filter = Annotated[str | None, typer.Option("--filter", metavar="KIND", help="Default: ickf where there is one.")]
WhichPart = Annotated[
    Part,
    typer.Option(
        help="filter: voltages and currents in, estimates out; drive: currents in, duty cycles and gates out; "
        "motor: duty cycles in, currents out."
    ),
]


def _folder(word: str, kind: str | None) -> tuple[GeneratedFolder, str]:
    from runtime.folders.resolve import drive_folder

    folder = drive_folder(word)
    return folder, folder.chosen(kind)


@app.command()
def fmu(
    drive: Word,
    out: Out,
    part: WhichPart = Part.filter,
    filter_kind: Filter = None,
    fmi: Annotated[int, typer.Option(min=2, max=3, help="Version of FMI.")] = 2,
) -> None:
    """A co-simulation FMU over the generated C, for this machine; its source lies in it for others."""
    from runtime.exports.fmu import binary_place, write_fmu

    folder, kind = _folder(drive, filter_kind)
    content = write_fmu(folder, kind, part.value, fmi)
    with whole_file(out) as file:
        file.write(content)
    say(f"Written: {out}, FMI {fmi}, {part.value} of {folder.drive}, for {binary_place(fmi)[0]}")


@app.command()
def sfunction(drive: Word, out: Out, part: WhichPart = Part.filter, filter_kind: Filter = None) -> None:
    """A level 2 C S-function for Simulink in one file, to be built there with mex."""
    from runtime.exports.blocks import sfunction_text

    folder, kind = _folder(drive, filter_kind)
    write_text(out, sfunction_text(folder, kind, part.value, out.stem))
    say(f'Written: {out}. In MATLAB: mex COPTIMFLAGS="-O2 -ffp-contract=off" {out.name}')


@app.command()
def plecs(drive: Word, out: Out, part: WhichPart = Part.filter, filter_kind: Filter = None) -> None:
    """A C-Script for PLECS in one header; its head says what belongs into the block's sections."""
    from runtime.exports.blocks import plecs_text

    folder, kind = _folder(drive, filter_kind)
    write_text(out, plecs_text(folder, kind, part.value, out.name))
    say(f"Written: {out}; its first lines are for the block's dialog.")


@app.command()
def a2l(
    drive: Word,
    out: Out,
    filter_kind: Filter = None,
    data_model: Annotated[
        DataModel, typer.Option(help="c28x: int of 16 bits, addresses count words; ilp32: int of 32 bits, bytes.")
    ] = DataModel.c28x,
    symbol: Annotated[str, typer.Option(metavar="NAME", help="The drive's variable in the firmware.")] = "drive",
    address: Annotated[
        str, typer.Option(metavar="HEX", help="Its address; 0: the tool takes it from the map file.")
    ] = "0",
) -> None:
    """An ASAP2 description of the drive's struct: all of it to measure, what is tuning to set."""
    from runtime.exports.a2l import a2l_text, read_address

    folder, kind = _folder(drive, filter_kind)
    write_text(out, a2l_text(folder, kind, data_model.value, symbol, read_address(address)))
    say(f"Written: {out}, {data_model.value}, variable '{symbol}'")
