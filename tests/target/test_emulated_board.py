"""The bench C on other processors than the host's, emulated: a 16-bit int (AVR), a Cortex-M4F with its own UART."""

from __future__ import annotations

import re
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from runtime.board.board import Board
from runtime.board.frames import ANSWER, DAMAGED, HELLO, REFUSED, RESET, STEP, Decoder, Frame, encode
from runtime.board.link import Link, SerialPort
from runtime.board.pil import run_pil
from runtime.board.session import inputs_of
from runtime.board.twin import Twin
from runtime.estimator.folder import GENERATED, find_folder
from tests.codegen.strict import need

HERE = Path(__file__).parent
P = "paper_spmsm_ickf"
FOLDER = GENERATED / "paper_spmsm"
SOURCES = [FOLDER / f"{P}.c", *(FOLDER / "board" / f"{name}.c" for name in (f"{P}_pil", "pmsm_pil", "pmsm_link"))]
COMMON = ["-O2", "-ffp-contract=off", f"-DFILTER={P}", f'-DHEADER="{P}_pil.h"', f"-I{FOLDER}", f"-I{FOLDER / 'board'}"]


def build(compiler: str, flags: list[str], main: Path, out: Path) -> None:
    command = [need(compiler), *flags, *COMMON, str(main), *map(str, SOURCES), "-o", str(out), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def requests() -> list[bytes]:
    """A talk with everything in it: steps, one twice, a damaged one, garbage, one out of turn."""
    u, y = inputs_of(find_folder("paper_spmsm"), None, 3)
    steps = [encode(Frame(3 + k, STEP, np.concatenate([u[k], y[k]]).astype("<f4").tobytes())) for k in range(3)]
    broken = bytearray(steps[1])
    broken[9] ^= 0x40
    late = encode(Frame(9, STEP, bytes(16)))
    talk = [encode(Frame(1, HELLO)), encode(Frame(2, RESET)), steps[0], steps[0], bytes(broken), b"\x07garbage"]
    return [*talk, steps[1], late, steps[2], encode(Frame(6, HELLO))]


def check_talk(answers: bytes) -> None:
    """The answers as the protocol has them, and the state words as the host computes them."""
    frames = Decoder().feed(answers)
    step, hello = STEP | ANSWER, HELLO | ANSWER
    expected = [hello, RESET | ANSWER, step, step, DAMAGED, DAMAGED, step, REFUSED, step, hello]
    assert [frame.command for frame in frames] == expected
    done = [frame for frame in frames if frame.command == step]
    assert [frame.sequence for frame in done] == [3, 3, 4, 5]
    assert done[0] == done[1]
    folder = find_folder("paper_spmsm")
    twin = Twin(folder, "ickf", "numpy", "float32")
    u, y = inputs_of(folder, None, 3)
    for k, frame in enumerate(done[1:]):
        words, _, _ = twin.step(u[k], y[k])
        assert frame.payload[8:] == words.astype("<f4").tobytes()
        assert int.from_bytes(frame.payload[4:8], "little") == 70001
    assert int.from_bytes(frames[-1].payload[3:5], "little") == 1  # repeats
    assert int.from_bytes(frames[-1].payload[5:7], "little") == 2  # damaged frames


def canned(tmp_path: Path, compiler: str, flags: list[str], run: list[str]) -> bytes:
    """The answers of the board with the compiled-in requests."""
    data = b"".join(requests())
    text = f"#define REQUEST_BYTES {len(data)}\nstatic const Uint16 requests[] = {{{', '.join(map(str, data))}}};\n"
    (tmp_path / "requests.h").write_text(text)
    program = tmp_path / "board.elf"
    build(compiler, [*flags, '-DREQUESTS="requests.h"', f"-I{tmp_path}"], HERE / "canned_board.c", program)
    done = subprocess.run([*run, str(program)], capture_output=True, text=True, check=False, timeout=120)
    return bytes(int(byte, 16) for byte in re.findall(r"=([0-9a-f]{2})", done.stdout + done.stderr))


def test_the_talk_on_the_host(tmp_path: Path) -> None:
    check_talk(canned(tmp_path, "gcc", [], []))


def test_the_talk_with_a_16_bit_int(tmp_path: Path) -> None:
    """The same program on an emulated ATmega1284P: int has 16 bits, as on the C28x."""
    avr = canned(tmp_path, "avr-gcc", ["-mmcu=atmega1284p"], [need("simavr"), "-m", "atmega1284p", "-f", "16000000"])
    check_talk(avr)


@pytest.mark.slow
def test_an_emulated_cortex_m4f_agrees_bit_for_bit(tmp_path: Path) -> None:
    """Processor in the loop as a user runs it: QEMU's mps2-an386 with its own UART and timer, at a pseudo-terminal."""
    flags = ["-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard", "-nostartfiles"]
    flags += ["-T", str(HERE / "emulated_m4.ld")]
    build("arm-none-eabi-gcc", flags, HERE / "emulated_m4.c", tmp_path / "m4.elf")
    words = [need("qemu-system-arm"), "-M", "mps2-an386", "-display", "none", "-monitor", "none", "-serial", "pty"]
    with subprocess.Popen([*words, "-kernel", str(tmp_path / "m4.elf")], stdout=subprocess.PIPE, text=True) as qemu:
        try:
            assert qemu.stdout is not None
            said = qemu.stdout.readline()
            name = re.search(r"/dev/\S+", said)
            assert name is not None, said
            port = SerialPort(name.group(), 115200)
            time.sleep(0.5)  # the emulator looks for a listener now and then only
            folder = find_folder("paper_spmsm")
            result = run_pil(Board(Link(port, 1.0, 20)), folder, *inputs_of(folder, None, 100), backend="c")
            port.close()
        finally:
            qemu.kill()
    assert result.passed, result.divergence or result.ended
    assert result.compared == 100
