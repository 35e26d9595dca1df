"""Ctrl-C and SIGTERM at any time: one line and the right code, nothing half done, no process left."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest

from tests.conftest import thoroughly
from tests.runtime.processes import finish, start

# --- interrupted ---


def interrupted(cwd: Path, *arguments: str, after: str | float) -> tuple[int, str, str]:
    """Ctrl-C to the whole group, as a terminal sends it, after a time or once a word was printed."""
    process = start("-m", "runtime", *arguments, cwd=cwd)
    assert process.stdout is not None
    if isinstance(after, str):
        for line in process.stdout:
            if after in line:
                break
        time.sleep(0.1)
    else:
        time.sleep(after)
    os.killpg(process.pid, signal.SIGINT)
    return finish(process)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "after"),
    [
        (("generate", "--out", "out", "ipmsm_flux"), "generating"),
        (("verify", "paper_spmsm", "spmsm_load_torque", "--json", "f"), "generating"),
        (("simulate", "--controller", "numpy", "--json", "f", "--out", "out"), "%"),
        *thoroughly(
            (("verify", "paper_spmsm", "--json", "f"), "generating"),
            (("compare", "paper_spmsm", "spmsm_load_torque", "ipmsm", "--json", "f", "--out", "out"), ":"),
            (("replay", "paper_spmsm", "data.csv", "--backend", "numpy", "--json", "f", "--out", "out.npz"), 3.0),
            (("--help",), 0.7),
        ),
    ],
)
def test_ctrl_c_is_one_line_and_130(arguments: tuple[str, ...], after: str | float, tmp_path: Path) -> None:
    rows = "\n".join(f"{k * 2e-5:.6f},1,0,0.1,0" for k in range(200_000))
    (tmp_path / "data.csv").write_text(f"t,u_alpha,u_beta,i_alpha,i_beta\n{rows}\n")
    code, _, err = interrupted(tmp_path, *arguments, after=after)
    if arguments == ("--help",):  # so early that it may have ended already, or the interpreter not begun
        assert code in {0, 130, -signal.SIGINT}
        return
    assert (code, err.splitlines()) == (130, ["pmsm-ickf: interrupted"])
    assert [path.name for path in tmp_path.iterdir()] == ["data.csv"], "nothing is left behind"


#: Ctrl-C while NumPy asks CasADi for a number: the KeyboardInterrupt comes out as a SystemError.
INSIDE_CASADI = """
import casadi
def toarray(self, simplify=False):
    os.kill(os.getpid(), signal.SIGINT)
casadi.DM.toarray = toarray
"""
#: Ctrl-C in a finaliser: the KeyboardInterrupt cannot be raised, and would be printed with a traceback.
INSIDE_A_FINALISER = """
import codegen.generate
class Last:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
draft = codegen.generate.draft
def ending(*arguments):
    Last()
    return draft(*arguments)
codegen.generate.draft = ending
"""
GENERATING = """
from runtime.__main__ import main
sys.argv[1:] = ["generate", "--out", "out", "paper_spmsm"]
main()
"""


@pytest.mark.parametrize("inside", [INSIDE_CASADI, *thoroughly(INSIDE_A_FINALISER)])
def test_ctrl_c_is_one_line_whatever_becomes_of_the_exception(inside: str, tmp_path: Path) -> None:
    code, _, err = finish(start("-c", f"import os, signal, sys{inside}{GENERATING}", cwd=tmp_path))
    assert (code, err.splitlines()) == (130, ["pmsm-ickf: interrupted"])
    assert not list(tmp_path.iterdir()), "nothing is left behind"


#: Ctrl-C where Rich has counted that it is within what it shows, and has not come to the ``try`` that counts back.
INSIDE_A_LINE = """
import os, signal
from rich.console import Console
from runtime.commands.terminal import console
from runtime.system.errors import remember_interrupts
enter = Console._enter_buffer
def interrupted(self):
    enter(self)
    Console._enter_buffer = enter
    os.kill(os.getpid(), signal.SIGINT)
Console._enter_buffer = interrupted
remember_interrupts()
try:
    console.print("the line itself")
    print("nobody heard it")
except KeyboardInterrupt:
    console.print("what is said of it")
"""


def test_ctrl_c_within_a_line_leaves_the_terminal_in_order(tmp_path: Path) -> None:
    code, out, err = finish(start("-c", INSIDE_A_LINE, cwd=tmp_path))
    assert (code, out.splitlines(), err) == (0, ["the line itself", "what is said of it"], "")


# --- ended ---

MARK = "PMSM_ICKF_STARTED_BY"


def descendants_of(mark: str) -> list[str]:
    """Command lines of all living processes that inherited a mark."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if f"{MARK}={mark}".encode() in (process / "environ").read_bytes().split(b"\0"):
                found.append((process / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace"))
        except OSError:  # ended meanwhile, or not ours
            continue
    return found


def all_gone(mark: str) -> bool:
    """Whether they are gone; they are given a while to be cleared away."""
    for _ in range(300):
        if not descendants_of(mark):
            return True
        time.sleep(0.1)
    return False


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "number", "code", "after"),
    [
        ("verify", signal.SIGTERM, 143, "reference along"),
        ("generate", signal.SIGTERM, 143, "generating"),
        *thoroughly(("verify", signal.SIGKILL, -signal.SIGKILL, "compiling")),
        *thoroughly(("generate", signal.SIGKILL, -signal.SIGKILL, "generating")),
    ],
)
def test_an_ended_command_leaves_no_process(command: str, number: int, code: int, after: str, tmp_path: Path) -> None:
    """A signal to the command alone, as a scheduler sends it: no worker goes on, nor what a worker has started."""
    mark = f"{tmp_path}"
    environment = {MARK: mark, "PMSM_ICKF_CACHE": str(tmp_path)}
    words = ["paper_spmsm", "spmsm_load_torque", *(("--out", str(tmp_path / "made")) if command == "generate" else ())]
    process = start("-m", "runtime", command, *words, cwd=tmp_path, environment=environment)
    assert process.stdout is not None
    for line in process.stdout:
        if after in line:
            break
    assert len(descendants_of(mark)) > 1, "it works with others"
    process.send_signal(number)
    assert finish(process)[0] == code
    assert all_gone(mark), descendants_of(mark)
    assert not (tmp_path / "made").exists(), "every drive is generated before a folder is written"
