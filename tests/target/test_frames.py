"""Frames on the line: the host's, the C's, and what damage can do to them."""

from __future__ import annotations

import re
import shutil
import struct
import subprocess
import time
import zlib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.board.board import Board
from runtime.board.frames import HELLO, STEP, Decoder, Frame, decode, encode, stuff, unstuff
from runtime.board.link import Link, NoAnswerError
from runtime.estimator.folder import GENERATED
from runtime.system.errors import UserError
from tests.codegen.strict import STRICT, need
from tests.conftest import DRIVES


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
