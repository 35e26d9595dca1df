"""The example interrupt on a board of this process: `board.c` with the generated text, called through ctypes.

The drive or the supervisor that the example calls is the generated one; the filters' steps are scripted.
"""

from __future__ import annotations

import atexit
import ctypes
import re
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
        ("nis", ctypes.c_float),
        ("rival_nis", ctypes.c_float),
        ("load", ctypes.c_float),
        ("rival_load", ctypes.c_float),
        ("duty_wanted", FLOAT3),
        ("v_wanted", FLOAT2),
        ("selftest", ctypes.c_int * 2),
        ("events", ctypes.c_char * 64),
        ("duty", FLOAT3),
        ("words", ctypes.c_float * 8),
        ("word_count", ctypes.c_int),
        ("x", ctypes.c_float * states),
        ("covariance", ctypes.c_float * words),
        ("tuning", ctypes.c_float),
        ("found_nis", ctypes.c_float),
        ("rival_x", ctypes.c_float * states),
        ("rival_covariance", ctypes.c_float * words),
        ("rival_tuning", ctypes.c_float),
        ("rival_found_nis", ctypes.c_float),
        ("rival_u", FLOAT2),
        ("u", FLOAT2),
        ("y", FLOAT2),
        ("command", FLOAT2),
        ("gain_max", ctypes.c_float),
        ("integrator", FLOAT4),
        ("v_acting", FLOAT2),
        ("v_queued", FLOAT2),
        ("delay", ctypes.c_int),
        ("loop", ctypes.c_float * 4),
        ("share", ctypes.c_float),
        ("anew", ctypes.c_int),
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

        Letters: p currents read, r rival's step, s step, l current loop, v space vectors, w duty written, 0 and 1 gates
        off and on, t telemetry, a acknowledged.
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

    def _place(self, name: str) -> Any:
        self.library.field.restype = ctypes.POINTER(ctypes.c_int)
        place = self.library.field(name.encode())
        assert place, f"the supervisor keeps no integer '{name}'"
        return place

    def kept(self, name: str) -> int:
        """An integer that the supervisor keeps."""
        return int(self._place(name)[0])

    def keep(self, name: str, value: int) -> None:
        """Set it, as a debugger does."""
        self._place(name)[0] = value

    def counted(self) -> set[str]:
        """Which integers of the supervisor, and of the example, are not 0."""
        self.library.interrupts_since_telemetry.restype = ctypes.POINTER(ctypes.c_int)
        ticks = {"ticks"} if self.library.interrupts_since_telemetry()[0] else set()
        return ticks | {name for name in integers(self.drive) if self.kept(name)}

    @property
    def mode(self) -> str:
        """Name of the drive's mode."""
        return str(self.module.MODES[self.kept("mode")])

    @property
    def reason(self) -> str:
        """Name of what went wrong last."""
        return str(self.module.REASONS[self.kept("reason")])

    @property
    def rivals(self) -> bool:
        """The drive has a second filter, and STARTING."""
        return "STARTING" in self.module.MODES

    def tune(self, value: float) -> None:
        """Set the filter's R[0] by hand."""
        self.library.tune(ctypes.c_float(value))

    @property
    def largest_current(self) -> Any:
        """A, of one element: the controller's maximum current between two interrupts."""
        self.library.largest_current.restype = ctypes.POINTER(ctypes.c_float * 1)
        return self.library.largest_current()[0]

    @property
    def torque(self) -> bool:
        """Whether the last step was followed by, or had, torque."""
        return self.share > 0

    @property
    def share(self) -> float:
        """Share of the largest current that the last step was allowed."""
        return float(self.now.gain_max / self.drive.control.max_current if self.variant else self.now.share)

    @property
    def P(self) -> np.ndarray:
        """Covariance (n, n) as the last step found it."""
        return np.asarray(self.module.unpack(np.array(self.now.covariance, dtype=float)))

    @property
    def rival_P(self) -> np.ndarray:
        """The rival's, as its last step found it."""
        return np.asarray(self.module.unpack(np.array(self.now.rival_covariance, dtype=float)))


def integers(drive: Drive) -> list[str]:
    """Names of the integers that the supervisor keeps, as its header lists them."""
    p = f"{drive.name}_{default_kind(drive.filter.kinds)}"
    header = (GENERATED / drive.name / f"{p}_supervisor.h").read_text()
    return re.findall(r"^    int (\w+);", header, re.M)


def _names(drive: Drive, kind: str, module: Any, variant: int) -> dict[str, Any]:
    """Macros: other names for what is scripted, and what board.c asks for."""
    p, n = f"{drive.name}_{kind}", len(module.STATES)
    names = {
        f"{p}_step": "scripted_step",
        f"{p}_foc_step": "scripted_foc_step",
        f"{p}_selftest": "scripted_selftest",
        f"{p}_foc_selftest": "scripted_foc_selftest",
        "WHOLE_CONTROLLER": variant,
        "N_WORDS": n * (n + 1) // 2,
        "COVARIANCE": module.COVARIANCE,
        "FILTER_T": f"{p}_t",
        "FOC_T": f"{p}_foc_t",
        "MAX_CURRENT_PLACE": Gains.names().index("max_current"),
        "SET_LOAD(f, value)": _set_load(module),
        "FIELDS": ", ".join(f'{{"{name}", &SUPERVISOR.{name}}}' for name in integers(drive)),
    }
    return names | ({"RIVAL": "SUPERVISOR.rival"} if "STARTING" in module.MODES else {})


def _set_load(module: Any) -> str:
    """Where a load torque is a state, a step leaves it as it is told."""
    return f"(f)->x[{module.STATES.index('load_torque')}] = (value)" if "load_torque" in module.STATES else "(void)(f)"


@lru_cache(maxsize=12)
def _compiled(name: str, variant: int) -> Path:
    """The library, once a process. Filter and controller keep their names: nobody calls their steps."""
    drive, folder = load_drive(name), GENERATED / name
    kind, module = default_kind(drive.filter.kinds), GeneratedFolder(GENERATED / name, checked=False).module
    scratch = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, scratch, ignore_errors=True)
    names = "".join(f"#define {macro} {text}\n" for macro, text in _names(drive, kind, module, variant).items())
    scripted = {
        "main": f'#include "example_isr.c"\n#define N {len(module.STATES)}\n#include "board.c"\n',
        "supervisor": f'#include "{name}_{kind}_supervisor.c"\n',
        "drive": f'#include "{name}_{kind}_drive.c"\n',
    }
    for stem, text in scripted.items():
        (scratch / f"{stem}.c").write_text(names + text)
    sources = [*(scratch / f"{stem}.c" for stem in scripted), *(folder / f"{name}_{kind}{e}.c" for e in ("", "_foc"))]
    made = scratch / "board.so"
    command = ["gcc", "-O0", "-shared", "-fPIC", "-ffp-contract=off", "-w", f"-I{folder}", f"-I{HERE}"]
    subprocess.run([*command, *map(str, sources), "-o", str(made)], check=True)
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
