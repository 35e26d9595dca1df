"""Link G over a pseudo-terminal: the bench C, compiled for this machine, behind a line that damages what it carries."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from runtime.board.board import Board
from runtime.board.link import Link, SerialPort
from runtime.board.pil import PilResult, run_pil
from runtime.board.session import inputs_of
from runtime.board.simulated import SimulatedBoard, board_sources, build_board
from runtime.board.twin import covariance_field
from runtime.estimator.folder import find_folder
from runtime.system.errors import UserError
from tests.conftest import DRIVES
from tests.target.command import call

pytestmark = pytest.mark.skipif(os.name != "posix", reason="not run: pseudo-terminals need a POSIX system")

P = covariance_field(find_folder("paper_spmsm"))
LINE = Path(__file__).with_name("damaging_line.py")


@contextmanager
def bad_line(program: Path, share: float, seed: int) -> Iterator[tuple[str, subprocess.Popen[str], dict[str, int]]]:
    """A board behind a damaging line: its port, the process that is the cable, and afterwards the damage done."""
    words = [sys.executable, str(LINE), str(program), str(share), str(seed)]
    damage: dict[str, int] = {}
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as cable:
        assert cable.stdout is not None
        try:
            yield cable.stdout.readline().strip(), cable, damage
        finally:
            cable.terminate()
            damage |= json.loads(cable.stdout.readline() or "{}")


def run_over_bad_line(drive: str, steps: int, share: float, seed: int) -> tuple[PilResult, dict[str, int]]:
    folder = find_folder(drive)
    with bad_line(build_board(folder, "ickf"), share, seed) as (name, _, damage):
        port = SerialPort(name, 115200)
        u, y = inputs_of(folder, None, steps)
        # Short patience: on a pseudo-terminal an answer takes well under a millisecond, and a late one does no harm.
        result = run_pil(Board(Link(port, timeout=0.02, attempts=40)), folder, u, y, backend="c")
        port.close()
    return result, damage


def check_bad_line(result: PilResult, damage: dict[str, int], steps: int) -> None:
    """Every step compared or reported lost, none wrong; and the damage was real."""
    assert result.ended == ""
    assert result.compared + len(result.lost) == steps
    assert result.different == 0
    assert result.divergence is None
    counts = result.counts
    assert counts.resent >= counts.damaged_answers > steps / 10
    assert counts.damaged_requests > steps / 20
    assert result.board_repeats is not None
    assert result.board_repeats > steps / 10  # steps done, answer damaged: answered again, not stepped again
    assert abs(sum(damage[kind] for kind in ("lost", "doubled", "corrupted")) / damage["bytes"] - 0.01) < 0.002
    # 40 tries, each good with probability 0.99^108 = 0.34 (26 bytes there, 82 back): a step is lost with
    # 0.66^40 = 6e-8, any of 10 000 with 6e-4.
    assert len(result.lost) == 0


def test_a_bad_line_loses_or_compares_but_never_mistakes() -> None:
    """1 % of the bytes lost, doubled or corrupted, in both directions."""
    result, damage = run_over_bad_line("paper_spmsm", 500, 0.01, seed=1)
    check_bad_line(result, damage, 500)


@pytest.mark.thorough
def test_ten_thousand_steps_over_a_bad_line() -> None:
    result, damage = run_over_bad_line("paper_spmsm", 10_000, 0.01, seed=2)
    print(f"compared {result.compared}, lost {len(result.lost)}, {result.counts}, damage {damage}")
    check_bad_line(result, damage, 10_000)


def test_a_hopeless_line_reports_lost_steps() -> None:
    """With few tries on a worse line steps are lost: said so, resynchronised, the others still right."""
    folder = find_folder("paper_spmsm")
    with bad_line(build_board(folder, "ickf"), 0.005, 3) as (name, _, _):
        port = SerialPort(name, 115200)
        board = Board(Link(port, timeout=0.02, attempts=30))
        original, board.step = board.step, lambda u, y: _few_tries(board, original, u, y)  # type: ignore[method-assign]
        u, y = inputs_of(folder, None, 200)
        result = run_pil(board, folder, u, y, backend="c")
        port.close()
    assert result.ended == ""
    assert len(result.lost) > 10
    assert result.compared + len(result.lost) == 200
    assert result.different == 0
    assert not result.passed


def _few_tries(board, original, u, y):  # type: ignore[no-untyped-def]
    board.link.attempts = 2
    try:
        return original(u, y)
    finally:
        board.link.attempts = 30


@pytest.mark.parametrize("name", DRIVES)
@pytest.mark.parametrize("mode", ["free", "single"])
def test_every_drive_agrees_bit_for_bit(name: str, mode: str) -> None:
    folder = find_folder(name)
    for kind in folder.kinds:
        with SimulatedBoard(folder, kind) as simulated:
            port = SerialPort(simulated.port, 115200)
            u, y = inputs_of(folder, None, 60)
            u[20] = np.nan  # a rejected input: u_held is part of the state
            result = run_pil(Board(Link(port, 0.5, 5)), folder, u, y, mode)
            port.close()
        assert result.passed, result.divergence
        assert (result.compared, result.counts.resent) == (60, 0)
        assert result.identity.kind == kind


def changed_board(folder_name: str, old: str, new: str) -> tuple[Path, str]:
    folder = find_folder(folder_name)
    sources = board_sources(folder, "ickf")
    name = f"{folder_name}_ickf.c"
    assert old in sources[name]
    sources[name] = sources[name].replace(old, new, 1)
    return build_board(folder, "ickf", sources), folder_name


def run_changed(program: Path, drive: str, steps: int, mode: str, tolerance: str) -> PilResult:
    folder = find_folder(drive)
    with bad_line(program, 0.0, 1) as (name, _, _):
        port = SerialPort(name, 115200)
        u, y = inputs_of(folder, None, steps)
        result = run_pil(Board(Link(port, 0.5, 5)), folder, u, y, mode, tolerance)
        port.close()
    return result


def flip_bit(step: int, element: str) -> str:
    """C at the end of a step that flips the last bit of one word once."""
    return (
        "    {\n        static int k;\n        union { float32 f; unsigned u; } w;\n"
        f"        w.f = f->{element};\n        w.u ^= (k++ == {step}) ? 1u : 0u;\n        f->{element} = w.f;\n    }}\n"
        "    f->iterations = iterations;\n    return status;"
    )


@pytest.mark.parametrize(
    ("mode", "element", "name", "different"),
    [("single", "x[2]", "omega", 1), ("single", f"{P}[3]", f"{P}_20", 1), ("free", "x[3]", "theta", None)],
)
def test_one_wrong_bit_is_found_and_named(mode: str, element: str, name: str, different: int | None) -> None:
    """The board's filter errs in the last bit of one word of one step."""
    end = "    f->iterations = iterations;\n    return status;"
    program, drive = changed_board("paper_spmsm", end, flip_bit(17, element))
    result = run_changed(program, drive, 40, mode, "bits")
    assert not result.passed
    divergence = result.divergence
    assert divergence is not None
    assert (divergence.step, divergence.element) == (17, name)
    assert int(divergence.expected_bits, 16) ^ int(divergence.found_bits, 16) == 1
    assert result.compared == 40
    assert result.different == (different or result.different) >= 1


def newton(text: str) -> str:
    """The C with division and square root as the F28335's libraries do them: a seed of 8 bits, two Newton steps."""
    while (match := re.search(r"(?<![/*]) / (\w+)(?=[;,) \n])", _without_comments(text))) is not None:
        start = _operand_start(text, match.start())
        text = f"{text[:start]}newton_divide({text[start : match.start()]}, {match.group(1)}){text[match.end() :]}"
    text = text.replace("PMSM_RECIPROCAL(", "newton_divide(1.0f, ").replace("PMSM_SQRT(", "newton_sqrt(")
    at = text.index("#define N_STATES")
    return text[:at] + NEWTON + text[at:]


def _without_comments(text: str) -> str:
    return re.sub(r"/\*.*?\*/", lambda match: " " * len(match.group()), text, flags=re.DOTALL)


def _operand_start(text: str, end: int) -> int:
    """Where the operand that ends at ``end`` begins: a word, or a pair of parentheses."""
    depth, k = 0, end - 1
    while True:
        depth += {")": 1, "(": -1}.get(text[k], 0)
        if depth == 0 and not re.match(r"[\w.]", text[k - 1]):
            return k
        k -= 1


NEWTON = r"""
typedef union { float32 f; Uint32 u; } seed_bits;
static float32 coarse(float32 value) /* eight bits of it */
{
    seed_bits w;
    w.f = value;
    w.u = (w.u + 0x8000u) & 0xFFFF0000u;
    return w.f;
}
static float32 newton_divide(float32 a, float32 b)
{
    float32 y = coarse(1.0f / b);
    y = y * (2.0f - y * b);
    y = y * (2.0f - y * b);
    return a * y;
}
static float32 newton_sqrt(float32 x)
{
    float32 y = coarse(1.0f / PMSM_SQRT(x));
    y = y * (1.5f - y * y * x * 0.5f);
    y = y * (1.5f - y * y * x * 0.5f);
    return x * y;
}
"""


@pytest.mark.parametrize("name", DRIVES)
def test_newton_division_differs_in_bits_and_keeps_the_certificate(name: str) -> None:
    """A stand-in for the chip's division and root: not IEEE, so bits differ; each step stays within the certificate."""
    folder = find_folder(name)
    sources = board_sources(folder, "ickf")
    sources[f"{name}_ickf.c"] = newton(sources[f"{name}_ickf.c"])
    program = build_board(folder, "ickf", sources)
    bits = run_changed(program, name, 300, "single", "bits")
    assert bits.different > 100
    certified = run_changed(program, name, 300, "single", "certificate")
    assert certified.passed, certified.divergence
    assert certified.used > 0.0
    assert certified.beyond <= 3


def test_the_certificate_is_no_rubber_stamp() -> None:
    """A motor constant wrong by 1e-4 stays small in every step, and is beyond the certificate."""
    text = find_folder("paper_spmsm").text("paper_spmsm_ickf.c")
    constant = re.search(r"#define GAIN_V (\S+)f", text)
    assert constant is not None
    wrong = f"#define GAIN_V {float(constant.group(1)) * 1.0001:.9g}f"
    program, drive = changed_board("paper_spmsm", constant.group(0), wrong)
    result = run_changed(program, drive, 300, "single", "certificate")
    assert not result.passed
    assert result.divergence is not None
    assert "certificate" in result.divergence.allowed


def test_another_drives_firmware_is_refused() -> None:
    mine, other = find_folder("paper_spmsm"), find_folder("spmsm_load_torque")
    with SimulatedBoard(other, "ckf") as simulated:
        port = SerialPort(simulated.port, 115200)
        board = Board(Link(port, 0.5, 5))
        with pytest.raises(UserError, match="was generated from drive 'spmsm_load_torque'"):
            run_pil(board, mine, *inputs_of(mine, None, 5))
        port.close()


def test_pulling_the_cable_keeps_what_was_compared() -> None:
    folder = find_folder("paper_spmsm")
    with bad_line(build_board(folder, "ickf"), 0.0, 1) as (name, cable, _):
        port = SerialPort(name, 115200)
        board = Board(Link(port, 0.05, 5))

        def pull(done: int) -> None:
            if done == 100:
                cable.kill()

        result = run_pil(board, folder, *inputs_of(folder, None, 1000), progress=pull)
        port.close()
    assert 100 <= result.compared < 1000
    assert result.different == 0
    assert "is the cable plugged in?" in result.ended
    assert not result.passed


def test_a_board_that_hangs_or_restarts_ends_the_run_in_bounded_time() -> None:
    """Stopped, it no longer answers; restarted, it refuses to go on in the middle."""
    folder = find_folder("paper_spmsm")
    with SimulatedBoard(folder, "ickf") as simulated:
        port = SerialPort(simulated.port, 115200)
        board = Board(Link(port, 0.02, 5))
        process = simulated._process
        u, y = inputs_of(folder, None, 50)
        hung = run_pil(board, folder, u, y, progress=lambda k: process.send_signal(signal.SIGSTOP) if k == 10 else None)
        process.send_signal(signal.SIGCONT)
        port.close()
    assert (hung.compared, hung.ended) == (10, "the board no longer answers")
    with SimulatedBoard(folder, "ickf") as simulated:
        port = SerialPort(simulated.port, 115200)
        link = Link(port, 0.2, 5)
        board = Board(link)

        def restart(k: int) -> None:
            if k == 10:
                link._sequence += 5  # what a board that has forgotten its number looks like from here

        again = run_pil(board, folder, u, y, progress=restart)
        port.close()
    assert again.compared == 10
    assert "did it restart?" in again.ended


def test_ctrl_c_keeps_what_was_compared() -> None:
    folder = find_folder("paper_spmsm")

    def interrupt(done: int) -> None:
        if done == 7:
            raise KeyboardInterrupt

    with SimulatedBoard(folder, "ickf") as simulated:
        port = SerialPort(simulated.port, 115200)
        result = run_pil(Board(Link(port, 0.5, 5)), folder, *inputs_of(folder, None, 50), progress=interrupt)
        port.close()
    assert result.interrupted
    assert (result.compared, result.different) == (7, 0)


def test_pil_command_end_to_end(tmp_path: Path) -> None:
    arguments = ("--port", "simulated", "--steps", "50", "--ticks-hz", "1e9", "--json", "g.json", "--backend", "c")
    done = call("pil", "spmsm_load_torque", *arguments, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "the board agrees bit for bit, 50 steps" in done.stdout
    facts = json.loads((tmp_path / "g.json").read_text())
    assert facts["passed"]
    assert facts["compared"] == 50
    assert facts["lost"] == []
    assert sum(facts["ticks"]["histogram"]["counts"]) == 50
    assert facts["ticks"]["seconds"]["min"] == facts["ticks"]["min"] / 1e9


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("--port", "no_such_port"), "cannot open port 'no_such_port'"),
        (("--port", "simulated", "--mode", "dance"), "no mode 'dance'; there are: free, single"),
        (("--port", "simulated", "--tolerance", "certificate", "--mode", "free"), "the certificate is of one step"),
        (("--port", "simulated", "--filter", "pf"), "has no filter 'pf'"),
        (("--port", "simulated", "--data", "none.csv"), "cannot be read as recorded data"),
        (("nothing", "--port", "simulated"), "no drive 'nothing'"),
    ],
)
def test_pil_refuses_in_one_line(arguments: tuple[str, ...], expected: str, tmp_path: Path) -> None:
    done = call("pil", *arguments, cwd=tmp_path)
    assert done.returncode == 2, done.stdout + done.stderr
    assert expected in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_without_pyserial_one_line_says_what_to_install(tmp_path: Path) -> None:
    (tmp_path / "serial.py").write_text("raise ImportError('no such module')\n")
    code = (
        "import sys; sys.path.insert(0, '.'); sys.argv = ['p', 'pil', '--port', 'x']; import runtime.cli as c; c.main()"
    )
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=env, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr == "pmsm-ickf: a serial port needs pyserial: pip install 'pmsm-ickf[board]'.\n"
