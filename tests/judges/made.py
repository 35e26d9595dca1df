"""Evidence made by hand: what judges and tables are given in the place of runs that take minutes."""

from __future__ import annotations

import io
import json
from collections import Counter
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from rich.console import Console

from runtime.board.board import Identity
from runtime.board.pil import PilResult
from runtime.cli import main
from runtime.drive.experiment import SweepPoint
from runtime.drive.fleet import Outcomes
from runtime.drive.scenario import Scenario
from runtime.drive.simulation import Run
from runtime.endurance.soak import Decade, Soak
from runtime.faults.catalogue import Fault
from runtime.faults.loop import FaultyRun
from runtime.faults.survey import Outcome, Recovery
from runtime.firmware.static.check import Check
from runtime.proof.link_cd import Drift
from runtime.proof.result import Link, Proof, Row
from runtime.proof.trajectory import Trajectory
from runtime.proof.verify import Evidence
from runtime.recorded.data import Recorded
from runtime.replay.innovations import Innovations
from runtime.replay.replay import Replay
from runtime.study.run import Group
from runtime.style.figures import pyplot
from tests.conftest import TASKS

#: The mode's number.
RUNNING = 4
#: r/min in a rad/s, said once more.
RPM = 60.0 / (2.0 * np.pi)


def command(*arguments: str) -> tuple[int, str]:
    """Exit code of the command line in this process, and everything it said; -1: it died of an exception."""
    said = io.StringIO()
    with redirect_stdout(said), redirect_stderr(said):
        try:
            main(list(arguments))
        except SystemExit as end:
            return int(end.code or 0), said.getvalue()
        except Exception as error:
            return -1, f"{said.getvalue()}{error!r}"
    return 0, said.getvalue()


def read_json(path: str | Path) -> Any:
    """The text that a command wrote."""
    assert Path(path).is_file(), f"{path} was not written"
    return json.loads(Path(path).read_text(encoding="utf-8"))


def text_of(renderable: Any, width: int = 240) -> str:
    """A table as a wide terminal shows it."""
    console = Console(width=width, record=True, file=io.StringIO())
    console.print(renderable, highlight=False)
    return console.export_text()


def cells_of(table: Any) -> list[list[str]]:
    """The rows of a Rich table, cell by cell, as text."""
    return [list(map(str, row)) for row in zip(*(column.cells for column in table.columns), strict=True)]


def row(worst: float = 0.25, allowed: float = 0.5, stage: str = "x_pred", compared: int = 10) -> Row:
    return Row("16", stage, "m", worst, allowed, compared)


def link(*rows: Row, name: str = "A-B", kind: str = "ckf", gain: str = "cubature", **more: Any) -> Link:
    return Link(name, "a claim", more.pop("drive", "d"), kind, gain, "some data", rows or (row(),), **more)


def proof(*links: Link, drive: str = "d", **more: Any) -> Proof:
    return Proof(drive, list(links), **more)


def evidence(N: int = 30) -> Evidence:
    """What a proof leaves for its figures."""
    t, pair = 1e-4 * np.arange(N), np.zeros((N, 2))
    exact: Any = None
    drift = Drift(np.full((N, 4), 1e-5), np.full(N, 1e-6), exact).envelope()
    return Evidence(t, {"ckf": drift}, {"cubature": t}, Trajectory(t, pair, pair, t, t, pair))


def earned() -> Any:
    """A step of the ablation, and its cost."""
    return SimpleNamespace(ablation=SimpleNamespace(name="literal"), operations=Counter(add=71), weight=4321)


def sweep() -> list[SweepPoint]:
    return [
        SweepPoint(1e-4, "euler", False, {"start": 1.0, "angle": 9.876}),
        SweepPoint(1e-4, "exact", True, {"start": 2.0, "angle": 1.0}),
    ]


#: A sample-time sweep.
POINTS = [
    SweepPoint(1e-4, "euler", False, {"start": 500.0}),
    SweepPoint(1e-4, "exact", True, {"start": 12.34}),
    SweepPoint(2e-5, "euler", True, {"start": 30.06}),
    SweepPoint(2e-5, "exact", True, {"start": 11.0}),
]


def check(state: Any = "passed", name: str = "a gate", **more: Any) -> Check:
    return Check(name, "a subject", state, more.pop("figure", "a figure"), "measured", tuple(more.pop("detail", ())))


def run(
    scenario: Scenario | str = "load_step",
    kind: str = "ckf",
    speed_error: Any = 0.0,
    angle_error: Any = 0.0,
    T: float = 1e-3,
    speed: float | None = None,
) -> Run:
    """A run of 0.4 s; errors of the estimate in r/min and degrees electrical, at t = T, 2 T, ..."""
    task = TASKS[scenario] if isinstance(scenario, str) else scenario
    t = T * np.arange(1, round(0.4 / T) + 1)
    N = len(t)
    omega = np.full(N, (task.speed if speed is None else speed) / RPM)
    theta = np.cumsum(4 * omega * T)
    x = np.zeros((N, 4))
    x[:, 2] = omega + np.broadcast_to(speed_error, N) / RPM
    x[:, 3] = np.remainder(theta + np.radians(np.broadcast_to(angle_error, N)) + np.pi, 2 * np.pi) - np.pi
    pair = np.column_stack([np.cos(theta), np.sin(theta)])
    return Run(
        scenario=task,
        kind=kind,
        state_names=("i_alpha", "i_beta", "omega", "theta"),
        t=t,
        u=10 * pair,
        i=pair,
        omega=omega,
        theta=theta,
        load_torque=task.load_torque(t),
        torque=np.zeros(N),
        x=x,
        angle_sigma=np.ones(N),
        duty=np.full((N, 3), 0.5),
        status=np.zeros(N, int),
    )


def group(kind: str, locked: Any, index: Any = None, drive: str = "d", drawn: Any = None, **figures: Any) -> Group:
    """Runs of a study; figures that are not given are 1, 2, 3, ..."""
    locked = np.asarray(locked, dtype=bool)
    usual = np.arange(1.0, len(locked) + 1)
    names = ("start", "load_step", "steady_rms", "angle", "angle_end", "lock_time", "status")
    columns = {name: np.asarray(figures.get(name, usual), dtype=float) for name in names}
    finite = np.asarray(figures.get("finite", np.ones(len(locked))), dtype=bool)
    reached = np.asarray(figures.get("reached", np.ones(len(locked))), dtype=bool)
    verdicts = {"locked": locked, "reached": reached, "finite": finite}
    modes = {name: np.asarray(figures.get(name, 0 * usual), dtype=int) for name in ("mode", "reason")}
    outcomes = Outcomes(**columns, **verdicts, **modes)
    index = np.arange(len(locked)) if index is None else np.asarray(index)
    return Group(drive, kind, index, drawn or {"theta": np.linspace(-90, 90, len(locked))}, outcomes)


def recovery(**changes: Any) -> Recovery:
    usual = Recovery(0.01, 3, 0x8, 5.0, 2.0, 30.0, 12.0, 0.004)
    return replace(usual, **changes)


def faulty_run(N: int = 400, T: float = 1e-3, first: int = 100, after: int = 110, **changes: Any) -> FaultyRun:
    """A healthy run at 100 rad/s, to be spoiled by ``changes``."""
    t = T * np.arange(1, N + 1)
    omega = np.full(N, 100.0)
    theta = np.cumsum(4 * omega * T)
    x = np.zeros((N, 4))
    x[:, 2], x[:, 3] = omega, np.remainder(theta + np.pi, 2 * np.pi) - np.pi
    usual: dict[str, Any] = {
        "kind": "ckf",
        "first": first,
        "after": after,
        "t": t,
        "reference": omega.copy(),
        "omega": omega,
        "theta": theta,
        "torque": np.zeros(N),
        "current": np.full(N, 3.0),
        "told": np.full(N, 300.0),
        "phase": np.zeros((N, 2)),
        "x": x,
        "duty": np.full((N, 3), 0.5),
        "status": np.zeros(N, int),
        "mode": np.full(N, RUNNING),
        "reason": np.zeros(N, int),
        "powered": np.ones(N, bool),
        "band": 20.0,
    }
    usual |= changes
    return FaultyRun(**({"running": usual["mode"] == RUNNING} | usual))


def outcome(*recoveries: Recovery, name: str = "lost", kind: str = "ckf", drive: str = "d", **more: Any) -> Outcome:
    fault = Fault(name, f"{name} title", lambda c, rng: None)  # type: ignore[arg-type, return-value]
    alone = more.get("alone", recoveries)
    return Outcome(drive, kind, fault, recoveries, tuple(alone), more.get("example", faulty_run()))


def decade(until: int = 100_000, **changes: Any) -> Decade:
    usual = Decade(until, (1e-6,) * 4, (2e-6,) * 4, (1e-4,) * 4, 1e-5, 0.1, 0.5, 0, 7, 0, -1, 0, 0)
    return replace(usual, **changes)


def soak(*decades: Decade, names: tuple[str, ...] = ("i_alpha", "i_beta", "omega", "theta"), **more: Any) -> Soak:
    units = ("A", "A", "rad/s", "rad", "Wb")[: len(names)]
    reference = more.pop("reference", (1e-6,) * len(names) + (1e-5,))
    made = Soak(more.pop("drive", "d"), "ickf", names, units, more.pop("sample_time", 1e-4), reference, list(decades))
    made.seconds, made.turned = more.pop("seconds", 2.0), more.pop("turned", 0.0)
    return made


def pil_result(**changes: Any) -> PilResult:
    identity = Identity("d", "ickf", "0" * 16, "0" * 16, "0.4.0", 4, 10, 5)
    usual: dict[str, Any] = {"mode": "free", "tolerance": "bits", "wanted": 3, "compared": 3, "ticks": [105, 115, 205]}
    return PilResult(identity, **(usual | changes))


def replayed(N: int = 200, T: float = 1e-3, truth: Any = None, **changes: Any) -> Replay:
    """A replay whose estimate is i = 0, omega = 100 rad/s, theta = 0 and whose variances are 0.01, 0.04, 4, 0.09."""
    t = T * np.arange(N)
    x = np.tile([0.0, 0.0, 100.0, 0.0], (N, 1))
    P = np.diag([0.01, 0.04, 4.0, 0.09])
    rng = np.random.default_rng(3)
    S = np.tile([0.04, 0.0, 0.25], (N, 1))
    usual: dict[str, Any] = {
        "drive": "d",
        "kind": "ickf",
        "backend": "c",
        "dtype": "float32",
        "sample_time": T,
        "state_names": ("i_alpha", "i_beta", "omega", "theta"),
        "state_units": ("A", "A", "rad/s", "rad"),
        "recorded": Recorded(Path("data.npz"), t, np.zeros((N, 2)), np.zeros((N, 2)), truth or {}),
        "x": x,
        "words": np.zeros((N, 10)),
        "status": np.zeros(N, int),
        "unpack": lambda words: np.tile(P, (len(words), 1, 1)),
        "notes": [],
        "errors": None,
        "innovations": Innovations(rng.normal(size=(N, 2)) * [0.2, 0.5], S),
        "consistency": None,
    }
    return Replay(**(usual | changes))


class Kept:
    """In the place of ``svg_text``: keeps the figure that would be written."""

    def __init__(self) -> None:
        self.figures: list[Any] = []

    def __call__(self, figure: Any) -> str:
        self.figures.append(figure)
        pyplot().close(figure)
        return "<svg/>"

    @property
    def axes(self) -> list[Any]:
        return list(self.figures[-1].axes)


def curves(axis: Any) -> dict[str, SimpleNamespace]:
    """The labelled lines of an axis: x and y."""
    return {
        line.get_label(): SimpleNamespace(x=np.asarray(line.get_xdata()), y=np.asarray(line.get_ydata()))
        for line in axis.lines
    }
