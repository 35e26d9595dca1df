"""Workers end with the block that they work for, whatever they think of it, and leave nothing."""

from __future__ import annotations

import multiprocessing
import signal
import tempfile
import threading
import time
from pathlib import Path

import pytest

from runtime.cli import main
from runtime.system import errors
from runtime.system.files import make_folder, write_text
from runtime.system.workers import workers


def _stubborn(told: Path) -> None:
    """Hears no polite signal, as a library that swallows its exception."""
    for polite in (signal.SIGINT, signal.SIGTERM):
        signal.signal(polite, signal.SIG_IGN)
    told.with_suffix(".part").write_text(tempfile.mkdtemp())
    told.with_suffix(".part").rename(told)
    time.sleep(600)


def _square(x: int) -> int:
    return x * x


def _wrong() -> None:
    raise ValueError("as it was raised")


def _interrupted(told: Path) -> None:
    with workers(1) as submit:
        submit(_stubborn, told)
        while not told.exists():
            time.sleep(0.02)
        raise KeyboardInterrupt


def test_results_come_back() -> None:
    with workers(2) as submit:
        assert [future.result() for future in [submit(_square, k) for k in range(5)]] == [0, 1, 4, 9, 16]


def test_an_error_comes_back() -> None:
    with pytest.raises(ValueError, match="as it was raised"), workers(1) as submit:
        submit(_wrong).result()


def test_a_worker_that_will_not_end_is_ended(tmp_path: Path) -> None:
    told = tmp_path / "place"
    earlier = multiprocessing.active_children()
    with pytest.raises(KeyboardInterrupt):
        _interrupted(told)
    assert [child for child in multiprocessing.active_children() if child not in earlier] == []
    assert not Path(told.read_text()).exists(), "its temporary files went with it"
    assert not Path(told.read_text()).parent.exists()


def test_an_interrupt_that_was_swallowed_begins_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """CasADi hears Ctrl-C and goes on; what follows it must not look finished."""
    event = threading.Event()
    monkeypatch.setattr(errors, "_interrupted", event)
    write_text(tmp_path / "before", "whole")
    event.set()
    for work in (lambda: write_text(tmp_path / "after", "late"), lambda: make_folder(tmp_path / "out")):
        with pytest.raises(KeyboardInterrupt):
            work()
    assert [path.name for path in tmp_path.iterdir()] == ["before"]
    errors.take_interrupt()  # as study does, which keeps what is done
    write_text(tmp_path / "kept", "in time")
    assert (tmp_path / "kept").read_text() == "in time"


def test_one_swallowed_to_the_end_is_told(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    event = threading.Event()
    event.set()
    monkeypatch.setattr(errors, "_interrupted", event)
    with pytest.raises(SystemExit) as end:
        main(["--version"])
    assert end.value.code == 130
    assert capsys.readouterr().err == "pmsm-ickf: interrupted\n"
