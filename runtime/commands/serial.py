"""Options of the commands that talk to a board: port and speed of the line."""

from __future__ import annotations

from typing import Annotated

import typer

Port = Annotated[
    str,
    typer.Option("--port", metavar="PORT", help="/dev/ttyUSB0, COM3, ...; 'simulated': a board made of this machine."),
]
Baud = Annotated[
    int, typer.Option("--baud", min=300, max=100_000_000, help="Bits a second, as the board's firmware sets them.")
]
