"""A board on a pseudo-terminal: the filter's C steps elsewhere, and every bit is compared.

The bench's C runs on this machine behind a pseudo-terminal, as a board would behind a serial port of another name
(`pip install 'pmsm-ickf[board]'`). Both go on from one start by themselves: a difference anywhere would stay in sight.
"""

from pathlib import Path

import numpy as np

from runtime import UserError, load
from runtime.board.board import Board
from runtime.board.link import Link, SerialPort
from runtime.board.pil import run_pil
from runtime.board.session import inputs_of
from runtime.board.simulated import SimulatedBoard
from runtime.estimator.folder import find_folder
from runtime.style.figures import pyplot, svg_text

folder = find_folder("servo_24v")
u, y = inputs_of(folder, None, 1500)
with SimulatedBoard(folder, "ckf") as simulated:
    try:
        port = SerialPort(simulated.port, 115200)
    except UserError as error:
        raise SystemExit(str(error)) from None
    board = Board(Link(port, 0.5, 20))
    result = run_pil(board, folder, u, y)
    port.close()
said = f"{result.compared} steps on the board, {result.different} differ from the host"
print(f"{said}, {len(result.lost)} lost")

x = load("servo_24v", filter="ckf", backend="c", dtype="float32").run(u, y).x
figure, axes = pyplot().subplots(2, 1, figsize=(7.0, 4.0), sharex=True)
time = 1e3 * folder.module.SAMPLE_TIME * np.arange(1, len(x) + 1)
axes[0].plot(time, x[:, 2] * 9.5493, color="#3b6ea8", lw=1.0)
axes[1].plot(time, x[:, 3], color="#3b6ea8", lw=0.8)
axes[0].set(ylabel="speed, r/min", title=said)
axes[1].set(xlabel="time, ms", ylabel="angle, rad")
Path("board_on_a_terminal.svg").write_text(svg_text(figure))
