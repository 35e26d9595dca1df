"""The example interrupt on a board of this process: `board.c` with the generated text, called through ctypes."""

from __future__ import annotations

import atexit
import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from codegen.render.drive import default_kind
from model.drives.load import load_drive
from model.loop.controller import Gains
from model.schema import Drive
from runtime.estimator.folder import GENERATED, GeneratedFolder

HERE = Path(__file__).parent
FLOAT2, FLOAT3, FLOAT4 = (ctypes.c_float * size for size in (2, 3, 4))


def _fields(states: int) -> list[tuple[str, Any]]:
    """Of ``board_t``, in the order of board.c."""
    words = states * (states + 1) // 2
    return [
        ("phase", FLOAT2),
        ("reference", ctypes.c_float),
        ("link", ctypes.c_float),
        ("status", ctypes.c_int),
        ("moves", ctypes.c_int),
        ("omega", ctypes.c_float),
        ("theta", ctypes.c_float),
        ("tuned", ctypes.c_float),
        ("duty_wanted", FLOAT3),
        ("v_wanted", FLOAT2),
        ("selftest", ctypes.c_int * 2),
        ("events", ctypes.c_char * 64),
        ("duty", FLOAT3),
        ("words", ctypes.c_float * 8),
        ("word_count", ctypes.c_int),
        ("x", ctypes.c_float * states),
        ("covariance", ctypes.c_float * words),
        ("u", FLOAT2),
        ("y", FLOAT2),
        ("command", FLOAT2),
        ("gain_max", ctypes.c_float),
        ("integrator", FLOAT4),
        ("v_acting", FLOAT2),
        ("v_queued", FLOAT2),
        ("delay", ctypes.c_int),
        ("loop", ctypes.c_float * 4),
        ("torque", ctypes.c_int),
        ("svgen", FLOAT3),
        ("tolerance", FLOAT2),
    ]


@dataclass
class Board:
    """One board with the example's interrupt on it.

    Attributes
    ----------
    drive : Drive
    variant : int
        WHOLE_CONTROLLER.
    now : ctypes.Structure
        What the next interrupt finds, and what the last one did.
    gates : bool
        Whether the inverter is enabled.
    """

    drive: Drive
    variant: int
    library: Any
    now: Any
    module: Any
    gates: bool = False
    events: str = field(default="")

    @property
    def T(self) -> float:
        """Sample time, s."""
        return self.drive.model.sample_time

    def interrupts(self, seconds: float) -> int:
        return round(seconds / self.T)

    def setup(self, filter_code: int = 0, controller_code: int = 0) -> int:
        """Power-up; what ``motor_setup`` returns."""
        self.now.selftest[:] = filter_code, controller_code
        return int(self._call(self.library.motor_setup))

    def interrupt(self, times: int = 1, **given: Any) -> str:
        """The interrupt, ``times`` times with the same board; the events of the last one, in order.

        Letters: p currents read, s step, l current loop, v space vectors, w duty written, 0 and 1 gates off and on,
        t telemetry, a acknowledged.
        """
        for name, value in given.items():
            if isinstance(value, tuple):
                getattr(self.now, name)[:] = value
            else:
                setattr(self.now, name, value)
        for _ in range(times):
            self._call(self.library.adc_isr)
        return self.events

    def until(self, event: str, most: int, **given: Any) -> int:
        """Interrupts until one has the event, that one included; 0 if none of ``most`` has."""
        for k in range(1, most + 1):
            if event in self.interrupt(**given):
                return k
        return 0

    def _call(self, function: Any) -> Any:
        self.now.events = b""
        found = function()
        self.events = self.now.events.decode()
        for letter in self.events:
            self.gates = {"0": False, "1": True}.get(letter, self.gates)
        return found

    def counting(self) -> str:
        """Which counters of the example are not 0: ticks, since, rejected, diverged, excess, content, mirrored."""
        self.library.counting.restype = ctypes.c_char_p
        return str(self.library.counting().decode())

    @property
    def torque(self) -> bool:
        """Whether the last step was followed by, or had, torque."""
        return bool(self.now.gain_max > 0) if self.variant else bool(self.now.torque)

    @property
    def P(self) -> np.ndarray:
        """Covariance (n, n) as the last step found it."""
        return np.asarray(self.module.unpack(np.array(self.now.covariance, dtype=float)))


def _text(drive: Drive, kind: str, module: Any, variant: int) -> str:
    """The translation unit: the example with other names, then board.c."""
    p, n = f"{drive.name}_{kind}", len(module.STATES)
    names = {
        f"{p}_step": "scripted_step",
        f"{p}_foc_step": "scripted_foc_step",
        f"{p}_selftest": "scripted_selftest",
        f"{p}_foc_selftest": "scripted_foc_selftest",
        "WHOLE_CONTROLLER": variant,
        "N": n,
        "N_WORDS": n * (n + 1) // 2,
        "COVARIANCE": module.COVARIANCE,
        "FILTER_T": f"{p}_t",
        "FOC_T": f"{p}_foc_t",
        "MAX_CURRENT_PLACE": Gains.names().index("max_current"),
    }
    before = [f"#define {name} {value}" for name, value in names.items() if name != "N"]
    return "\n".join([*before, '#include "example_isr.c"', f"#define N {n}", '#include "board.c"', ""])


@lru_cache(maxsize=8)
def _compiled(name: str, variant: int) -> Path:
    """The library, once a process."""
    drive, folder = load_drive(name), GENERATED / name
    kind = default_kind(drive.filter.kinds)
    sources = [str(folder / f"{name}_{kind}{end}.c") for end in ("", "_foc")]
    scratch = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, scratch, ignore_errors=True)
    main, made = scratch / "main.c", scratch / "board.so"
    main.write_text(_text(drive, kind, GeneratedFolder(folder, checked=False).module, variant))
    command = ["gcc", "-O0", "-shared", "-fPIC", "-ffp-contract=off", "-w", f"-I{folder}", f"-I{HERE}"]
    subprocess.run([*command, str(main), *sources, "-o", str(made)], check=True)
    return made


@contextmanager
def on_board(name: str, variant: int) -> Iterator[Board]:
    """A board that has just been switched on: a copy of the library, whose static variables nobody has touched."""
    with tempfile.TemporaryDirectory() as scratch:
        library = ctypes.CDLL(shutil.copy(_compiled(name, variant), scratch))
        structure = type("board_t", (ctypes.Structure,), {"_fields_": _fields(library.states())})
        now = structure.in_dll(library, "board")
        module = GeneratedFolder(GENERATED / name, checked=False).module
        yield Board(load_drive(name), variant, library, now, module)
