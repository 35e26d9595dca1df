"""Link G over a pseudo-terminal: the bench C, compiled for this machine, behind a line that damages what it carries."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.board.board import Board
from runtime.board.frames import HELLO, STEP, Decoder, Frame, decode, encode, stuff, unstuff
from runtime.board.link import Link, NoAnswerError, SerialPort
from runtime.board.pil import PilResult, run_pil
from runtime.board.record import COLUMNS, Receiver
from runtime.board.recorded import RecordFile, read_inputs
from runtime.board.session import inputs_of
from runtime.board.simulated import SimulatedBoard, board_sources, build_board
from runtime.errors import UserError
from runtime.estimator.folder import GENERATED, find_folder
from tests.codegen.strict import STRICT, need
from tests.conftest import DRIVES

pytestmark = pytest.mark.skipif(os.name != "posix", reason="not run: pseudo-terminals need a POSIX system")

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


@pytest.mark.slow
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
    [("single", "x[2]", "omega", 1), ("single", "P[3]", "P_20", 1), ("free", "x[3]", "theta", None)],
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
    text = text.replace("PMSM_SQRT(", "newton_sqrt(")
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


# --- frames


class Deaf:
    """A port on which nothing is ever heard."""

    def __init__(self, echo: bool = False) -> None:
        self.echo, self.waiting, self.sent = echo, b"", 0

    def read(self) -> bytes:
        time.sleep(0.001)
        data, self.waiting = self.waiting, b""
        return data

    def write(self, data: bytes) -> None:
        self.sent += 1
        self.waiting += data if self.echo else b""

    def close(self) -> None: ...


def test_retries_are_bounded_and_silence_teaches() -> None:
    deaf = Deaf()
    link = Link(deaf, timeout=0.005, attempts=4)
    with pytest.raises(NoAnswerError):
        link.request(STEP)
    assert (deaf.sent, link.counts.resent, link.counts.timeouts) == (4, 3, 4)
    with pytest.raises(UserError, match="is it running"):
        Board(Link(Deaf(), 0.005, 2))
    with pytest.raises(UserError, match="transmit and receive are bridged"):
        Board(Link(Deaf(echo=True), 0.005, 2))


@given(st.binary(max_size=240))
@settings(max_examples=200, deadline=None)
def test_cobs_has_no_zero_and_comes_back(body: bytes) -> None:
    assert b"\0" not in stuff(body)
    assert unstuff(stuff(body)) == body


def test_crc_is_that_of_ieee_802_3() -> None:
    """The check value every CRC catalogue gives for CRC-32, and zlib's on a whole frame."""
    assert zlib.crc32(b"123456789") == 0xCBF43926
    coded = encode(Frame(0x1234, STEP, b"\1\0\2"))
    body = unstuff(coded[1:-1])
    assert body is not None
    assert struct.unpack("<I", body[-4:])[0] == zlib.crc32(body[:-4])


def test_garbage_is_followed_by_the_next_frame() -> None:
    frame = Frame(7, HELLO, bytes(range(20)))
    decoder = Decoder()
    assert decoder.feed(b"\xff\x03noise" + encode(frame)[:10]) == []
    assert decoder.feed(b"\x05" * 3000 + encode(frame) + b"\x02") == [frame]
    assert decoder.feed(b"\x00" + encode(frame)) == [frame]
    assert decoder.bad == 3  # the noise, the cut frame with the fives, the two


def test_every_single_damaged_byte_is_caught() -> None:
    """Every byte of a frame lost, doubled, and changed to each other value: never another frame."""
    frame = Frame(3, STEP, struct.pack("<4f", 1.0, -2.5, 0.0, 3.25))
    coded = encode(frame)[1:-1]
    for k in range(len(coded)):
        shorter, longer = coded[:k] + coded[k + 1 :], coded[:k] + coded[k : k + 1] + coded[k:]
        others = [coded[:k] + bytes([value]) + coded[k + 1 :] for value in range(256) if value != coded[k]]
        for damaged in (shorter, longer, *others):
            pieces = [decode(piece) for piece in damaged.split(b"\0") if piece]
            assert all(found is None for found in pieces)


# --- the C itself


@pytest.mark.parametrize(
    ("compiler", "flags"),
    [("avr-gcc", ["-mmcu=atmega1284p"]), ("arm-none-eabi-gcc", ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard"])],
)
def test_bench_c_is_clean_for_other_machines(compiler: str, flags: list[str], tmp_path: Path) -> None:
    """Sixteen-bit int, and a Cortex-M4F."""
    need(compiler)
    wanted = [flag for flag in STRICT if flag not in {"-Wdouble-promotion", "-Wunsuffixed-float-constants"}]
    for name in DRIVES:
        folder = GENERATED / name
        for path in sorted((folder / "board").glob("*.c")):
            command = [compiler, *flags, *wanted, "-O2", f"-I{folder}", "-c", str(path), "-o", str(tmp_path / "x.o")]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr


def test_bench_c_holds_no_char_and_measures_no_bytes() -> None:
    """On the C28x a char has 16 bits and sizeof counts words: neither may appear; nor float literals, nor 64 bits."""
    for path in sorted(GENERATED.glob("*/board/*.[ch]")):
        code = re.sub(r'/\*.*?\*/|extern "C"', "", path.read_text(), flags=re.DOTALL)
        assert not re.search(r"\b(char|sizeof|double|long|malloc|static \w+ \w+;|goto)\b", code), path
        assert not re.search(r"^static (?!const)\w+ \w+(\[|;| =)", code, flags=re.MULTILINE), path


@pytest.mark.parametrize("drive", ["paper_spmsm"])
def test_c_sends_the_frames_the_host_knows(drive: str, tmp_path: Path) -> None:
    """Bytes in wider words than 16 bits too: only their low bits may matter."""
    folder = GENERATED / drive
    port = (folder / "pmsm_port.h").read_text()
    wide = re.sub(r"typedef unsigned short Uint16;", "typedef unsigned int Uint16;", port)
    wide = re.sub(r"typedef int pmsm_Uint16_must.*\n", "", wide)
    main = r"""
#include <stdio.h>
#include "pmsm_link.h"
static unsigned char line[600]; static int n, at;
int pmsm_board_get(void) { return at < n ? line[at++] : -1; }
int pmsm_board_put(Uint16 byte) { line[n++] = (unsigned char)byte; printf("%02x", (unsigned)byte); return 1; }
Uint32 pmsm_board_ticks(void) { return 0; }
int main(void) { static pmsm_link_t link; float32 v[3] = {1.5f, 0.0f, -2.0f}, w[3]; Uint16 s, c;
  pmsm_link_init(&link); pmsm_link_begin(&link, 0xFFFEu, 0x84u); pmsm_link_write_floats(&link, v, 3);
  pmsm_link_end(&link); pmsm_link_flush(&link);
  if (pmsm_link_receive(&link) != PMSM_LINK_GOOD) return 1;
  s = pmsm_link_read_16(&link); c = pmsm_link_read_8(&link); pmsm_link_read_floats(&link, w, 3);
  return !(s == 0xFFFEu && c == 0x84u && w[0] == v[0] && w[2] == v[2] && pmsm_link_left(&link) == 0); }
"""
    lines = []
    for name, header in (("narrow", port), ("wide", wide)):
        place = tmp_path / name
        place.mkdir()
        (place / "pmsm_port.h").write_text(header)
        (place / "main.c").write_text(main)
        for end in (".h", ".c"):
            shutil.copy(folder / "board" / f"pmsm_link{end}", place)
        subprocess.run(["gcc", "main.c", "pmsm_link.c", "-o", "main"], cwd=place, check=True)
        done = subprocess.run([str(place / "main")], capture_output=True, text=True, check=False)
        assert done.returncode == 0
        lines.append(done.stdout)
    assert lines[0] == lines[1] == encode(Frame(0xFFFE, 0x84, struct.pack("<3f", 1.5, 0.0, -2.0))).hex()


# --- recording


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
    u, y = read_inputs(path)
    assert u.shape == y.shape == (1000, 2)
    np.testing.assert_array_equal(u[:, 0].astype(np.float32), np.array([row[1] for row in rows], dtype=np.float32))
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    if suffix == ".npz":
        with np.load(path) as data:
            assert set(data) == set(COLUMNS)
            assert "omega" not in data


@pytest.mark.parametrize(
    ("text", "expected"),
    [("t,u_alpha\n0,1\n", "lacks the column u_beta"), ("", "lacks the column"), ("t,u_alpha\n0,x\n", "cannot be read")],
)
def test_bad_recorded_data_is_one_line(text: str, expected: str, tmp_path: Path) -> None:
    (tmp_path / "d.csv").write_text(text)
    with pytest.raises(UserError, match=expected):
        read_inputs(tmp_path / "d.csv")


# --- the command line


def call(*arguments: str, cwd: Path, **more: str) -> subprocess.CompletedProcess[str]:
    root = str(Path(__file__).parents[2])
    env = {**os.environ, "PYTHONPATH": root, **more}
    command = [sys.executable, "-m", "runtime.cli", *arguments]
    return subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, check=False, timeout=120)


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
        (("--port", "simulated", "--mode", "dance"), "mode 'dance' is not one of"),
        (("--port", "simulated", "--tolerance", "certificate", "--mode", "free"), "the certificate is of one step"),
        (("--port", "simulated", "--filter", "pf"), "has no filter 'pf'"),
        (("--port", "simulated", "--data", "none.csv"), "cannot be read as recorded data"),
        (("nothing", "--port", "simulated"), "no generated drive 'nothing'"),
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
