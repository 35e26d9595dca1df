"""Recording what a board sends: gaps marked, nothing lost in a crash."""

from __future__ import annotations

import os
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from runtime.board.frames import Frame, encode
from runtime.board.live import AXES, _draw
from runtime.board.record import COLUMNS, Receiver, Recording, UnpluggedError, record
from runtime.board.recorded import RecordFile
from runtime.recorded.data import read_recorded
from runtime.system.errors import UserError
from tests.target.command import call

pytestmark = pytest.mark.skipif(os.name != "posix", reason="not run: pseudo-terminals need a POSIX system")


def telemetry(sequence: int, sample: int, value: float = 1.0) -> bytes:
    return encode(Frame(sequence, 0xE0, struct.pack("<fI6f", 2e-5, sample, *[value] * 6)))


def test_gaps_are_counted_and_marked() -> None:
    receiver = Receiver()
    rows = []
    for sequence, sample in ((65534, 10), (65535, 20), (2, 50), (2, 50), (3, 80)):
        rows += receiver.feed(telemetry(sequence, sample))
    recording = receiver.recording
    assert [row[COLUMNS.index("lost_before")] for row in rows] == [0, 0, 2, 0]
    np.testing.assert_allclose([row[0] for row in rows], 2e-5 * np.array([0, 10, 40, 70]), rtol=1e-12)
    assert (recording.lost, recording.gaps, recording.doubled, recording.left_out) == (2, 1, 1, 1)
    rows = receiver.feed(telemetry(0, 5))
    assert recording.restarts == 1
    assert rows[0][0] == pytest.approx(71 * 2e-5)


def test_a_pulled_cable_keeps_what_came() -> None:
    class Port:
        def __init__(self) -> None:
            self.frames = [telemetry(k, k) for k in range(7)]

        def read(self) -> bytes:
            if not self.frames:
                raise UnpluggedError("port 'p' failed")
            return self.frames.pop(0)

        def write(self, data: bytes) -> None: ...

        def close(self) -> None: ...

    class Sink:
        rows: ClassVar[list[tuple[float, ...]]] = []

        def append(self, rows: list[tuple[float, ...]]) -> None:
            self.rows.extend(rows)

    recording = record(Port(), Sink(), None)
    assert len(Sink.rows) == recording.rows == 7
    assert "is the cable plugged in?" in recording.ended


@pytest.mark.parametrize("suffix", [".npz", ".csv"])
def test_a_recording_survives_a_crash_and_is_recorded_data(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"r{suffix}"
    rows = [(k * 1e-4, *(np.float32(0.1 * k) + j for j in range(6)), float(k), 0.0) for k in range(1000)]
    file = RecordFile(path, COLUMNS)
    file.append(rows[:600])
    if suffix == ".npz":  # the process dies here: what was flushed is a whole array file
        kept = np.load(tmp_path / "r.npz.part")
        assert len(kept) == 600
        np.testing.assert_array_equal(kept["u_alpha"], [row[1] for row in rows[:600]])
        with pytest.raises(UserError, match="did not end well"):
            RecordFile(path, COLUMNS)
    file.append(rows[600:])
    file.close()
    recorded = read_recorded(path)
    u, y = recorded.u, recorded.y
    np.testing.assert_allclose(recorded.t, [row[0] for row in rows])
    assert u.shape == y.shape == (1000, 2)
    np.testing.assert_array_equal(u[:, 0].astype(np.float32), np.array([row[1] for row in rows], dtype=np.float32))
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    if suffix == ".npz":
        with np.load(path) as data:
            assert set(data) == set(COLUMNS)
            assert "omega" not in data


def test_live_curves_are_drawn_from_what_has_come() -> None:
    """Without a window: an empty recording draws nothing, ten rows draw every curve."""
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, _ = pyplot.subplots(len(AXES), 1)
    recording = Recording()
    _draw(figure, recording)
    assert not figure.axes[0].lines
    recording.recent.extend([tuple(float(k + j) for j in range(len(COLUMNS))) for k in range(10)])
    _draw(figure, recording)
    assert [len(axes.lines) for axes in figure.axes] == [len(names) for names in AXES.values()]
    pyplot.close(figure)


def test_record_command_until_ctrl_c(tmp_path: Path) -> None:
    """Ctrl-C ends a recording well: what came is there."""
    root = str(Path(__file__).parents[2])
    words = [sys.executable, "-m", "runtime.cli", "record", "--port", "simulated", "--out", "r.npz"]
    process = subprocess.Popen(
        words, cwd=tmp_path, env={**os.environ, "PYTHONPATH": root}, stdout=subprocess.PIPE, text=True
    )
    part = tmp_path / "r.npz.part"
    for _ in range(1000):
        time.sleep(0.02)
        if part.exists() and part.stat().st_size > 5000:
            break
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=60)
    assert process.returncode == 0, out
    with np.load(tmp_path / "r.npz") as data:
        assert len(data["t"]) > 50
        # the simulated board turns a current of 1 A and a voltage of 10 V
        np.testing.assert_allclose(np.hypot(data["i_alpha"], data["i_beta"]), 1.0, rtol=1e-6)
        np.testing.assert_allclose(np.hypot(data["u_alpha"], data["u_beta"]), 10.0, rtol=1e-6)
    again = call("record", "--port", "simulated", "--out", "r.npz", cwd=tmp_path)
    assert again.returncode == 2
    assert "'r.npz' exists" in again.stderr
