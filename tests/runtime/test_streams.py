"""Input and output of a command that are closed, full, or read by nobody: the right code, one line, no traceback."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.runtime.processes import ROOT, finish, start

UNREAD = 141


def shell(line: str, cwd: Path) -> tuple[int, str]:
    """Exit code and stderr of a line of Bash in which ``$M`` is the command; that of a pipe is its first one's."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "M": f"{sys.executable} -m runtime"}
    words = ["bash", "-c", f"set -o pipefail; {line}"]
    done = subprocess.run(words, cwd=cwd, env=environment, capture_output=True, text=True, timeout=300)
    return done.returncode, done.stderr


@pytest.mark.parametrize(
    ("line", "code", "said"),
    [
        ("$M --version >&-", 0, ""),
        ("$M --version <&- >&- 2>&-", 0, ""),
        ("$M doctor --json found.json <&- >&- 2>&-; test -s found.json", 0, ""),
        ("$M simulate nope 2>&-", 2, ""),
        ("$M simulate nope 2>/dev/full", 2, ""),
        ("$M new motor <&- >/dev/null", 2, "the answers end before the facts are whole"),
        ("$M --version >/dev/full", 2, "No space left on device: where the output of the command goes"),
        ("$M verify --help >/dev/full", 2, "No space left on device: where the output of the command goes"),
        ("(sleep 2; $M --version) | true", UNREAD, ""),
        ("(sleep 2; $M verify --help) | true", UNREAD, ""),
        ("(sleep 2; $M doctor --json /dev/stdout) | true", UNREAD, ""),
        ("(sleep 2; $M doctor --json /dev/stdout) > >(true)", UNREAD, ""),
        ("(sleep 2; exec 3>&1; $M doctor --json /dev/fd/3 >/dev/null) | true", UNREAD, ""),
        ("$M simulate --scenario load_step --filters ckf --json /dev/stdout | true", UNREAD, ""),
        ("$M doctor --json /dev/full", 2, "cannot write '/dev/full': No space left on device."),
        ("$M verify <(echo)", 2, "it is a pipe or a device, and a drive file is read more than once"),
        ("touch motor.txt; $M simulate motor.txt", 2, "a drive file's name ends in .toml, which this one's does not."),
        ("mkfifo pipe.toml; $M generate pipe.toml", 2, "it is a pipe or a device, and a drive file is read"),
    ],
)
def test_streams_that_are_closed_full_or_read_by_nobody(line: str, code: int, said: str, tmp_path: Path) -> None:
    found, err = shell(line, tmp_path)
    assert found == code, err
    assert len(err.splitlines()) == bool(said)
    assert said in err


def test_a_closed_stream_is_not_taken_by_the_next_file(tmp_path: Path) -> None:
    """Else what a compiler says on stderr would be written into it."""
    program = """
import subprocess
from runtime.system.streams import open_streams
open_streams()
with open("kept", "w") as file:
    file.write("kept")
    file.flush()
    subprocess.run(["sh", "-c", "echo noise; echo noise >&2"])
"""
    code, err = shell(f"{sys.executable} -c '{program}' <&- >&- 2>&-", tmp_path)
    assert (code, err) == (0, "")
    assert (tmp_path / "kept").read_text() == "kept"


def test_a_pipe_to_another_program_that_breaks_is_no_lost_reader(tmp_path: Path) -> None:
    """A board that is unplugged, a program that dies: said in a line, with the code of bad input."""
    program = """
import runtime.commands.doctor as module
import runtime.cli
def doctor() -> None:
    raise BrokenPipeError(32, "Broken pipe")
module.doctor = doctor
from runtime.__main__ import main
import sys
sys.argv[1:] = ["doctor"]
main()
"""
    code, _, err = finish(start("-c", program, cwd=tmp_path))
    assert (code, err) == (2, "pmsm-ickf: a program or board that this command writes to has gone: Broken pipe.\n")


def test_ctrl_c_is_watched_before_anything_that_takes_long_is_loaded(tmp_path: Path) -> None:
    """The package itself loads what is asked of it when it is asked."""
    asked = (
        "import sys, runtime.__main__; print('numpy' in sys.modules); from runtime import load, UserError; "
        "print('numpy' in sys.modules, load.__name__, UserError.__name__, {'load', 'Trace'} <= {*dir(runtime)})"
    )
    code, out, err = finish(start("-c", asked, cwd=tmp_path))
    assert (code, out.splitlines(), err) == (0, ["False", "True load UserError True"], "")
    code, _, err = finish(start("-c", "import runtime; runtime.nothing", cwd=tmp_path))
    assert "module 'runtime' has no attribute 'nothing'" in err
