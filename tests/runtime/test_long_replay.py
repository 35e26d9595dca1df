"""Long recordings: covariances that are worked out again, and memory that does not grow with them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import runtime.replay.words
from runtime.estimator.folder import find_folder
from runtime.recorded.data import Recorded, read_recorded
from runtime.replay import replay as replays
from runtime.replay.replay import Replay, Settings, replay
from tests.conftest import thoroughly
from tests.runtime.test_unlike import columns_of

KEPT_BYTES = 5_000


@pytest.fixture
def recorded(tmp_path: Path) -> Recorded:
    """With gaps, rejected rows at the seams of pieces, and a stretch of absurd voltages."""
    columns = columns_of("spmsm_load_torque")
    columns["u_alpha"][[199, 200, 201, 400]] = np.nan
    columns["i_beta"][600:640] = 1e30
    columns["u_beta"][900:905] = -390.0
    keep = np.r_[0:397, 404:800, 1001:1500]
    np.savez(tmp_path / "d.npz", **{name: column[keep] for name, column in columns.items()})
    return read_recorded(tmp_path / "d.npz")


def in_pieces(recorded: Recorded, backend: str, chunk: int, kept: int, monkeypatch: pytest.MonkeyPatch) -> Replay:
    monkeypatch.setattr(replays, "CHUNK", {"c": chunk, "numpy": chunk})
    monkeypatch.setattr(runtime.replay.words, "KEPT", kept)
    return replay(find_folder("spmsm_load_torque"), recorded, Settings("ickf", backend))


@pytest.mark.parametrize("backend", ["c", *thoroughly("numpy")])
def test_pieces_and_what_is_worked_out_again_are_the_bits_of_one_run(
    backend: str, recorded: Recorded, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = in_pieces(recorded, backend, 10_000, 1 << 30, monkeypatch)
    words = np.asarray(whole.words)
    N = len(recorded.t)
    for chunk, kept in ((200, 1 << 30), (200, 0), (199, KEPT_BYTES), (7, 0)):
        found = in_pieces(recorded, backend, chunk, kept, monkeypatch)
        for name in ("x", "status"):
            np.testing.assert_array_equal(getattr(found, name), getattr(whole, name))
        np.testing.assert_array_equal(found.innovations.nu, whole.innovations.nu)
        np.testing.assert_array_equal(found.innovations.S, whole.innovations.S)
        for rows in (slice(None), slice(-1, None), slice(5, 450, 7), np.array([0, 1, 396, 397, N - 1, 2])):
            np.testing.assert_array_equal(found.words[rows], words[rows])
        assert len(found.words[3:3]) == 0
        np.testing.assert_array_equal(found.P(np.array([N - 1])), whole.P(np.array([N - 1])))
        assert found.notes == whole.notes


def test_a_run_goes_on_where_it_was_after_words_were_asked_for(
    recorded: Recorded, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = in_pieces(recorded, "c", 50, 0, monkeypatch)
    first = np.asarray(found.words[:10])
    np.testing.assert_array_equal(found.words[-5:], np.asarray(found.words)[-5:])
    np.testing.assert_array_equal(found.words[:10], first)


MEASURED = """
import resource, runpy, sys
limit = int(sys.argv.pop(1))
resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
sys.argv[0] = "pmsm-ickf"
runpy.run_module("runtime", run_name="__main__", alter_sys=False)
"""


@pytest.mark.thorough
@pytest.mark.parametrize(("suffix", "rows", "bound"), [("npz", 3_000_000, 650), ("csv", 1_500_000, 480)])
def test_memory_is_bounded(suffix: str, rows: int, bound: int, tmp_path: Path) -> None:
    """Within ``bound`` MB that the system enforces; keeping every covariance and the text took 900 and 600."""
    columns = columns_of("spmsm_load_torque")
    times = -(-rows // len(columns["t"]))
    names = ("u_alpha", "u_beta", "i_alpha", "i_beta")
    made = {"t": 1e-4 * np.arange(1, rows + 1)} | {name: np.tile(columns[name], times)[:rows] for name in names}
    path = tmp_path / f"d.{suffix}"
    if suffix == "npz":
        np.savez(path, **made)
    else:
        np.savetxt(
            path, np.column_stack(list(made.values())), delimiter=",", fmt="%.8g", header=",".join(made), comments=""
        )
    command = [sys.executable, "-c", MEASURED, str(bound * 1_000_000), "replay", "spmsm_load_torque", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    assert f"{rows:,} samples" in done.stdout
