"""The commissioning C: the gates are on while a plan runs within its limits, and never else."""

from __future__ import annotations

import ctypes
import math
import struct
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.board.frames import ANSWER, Decoder, Frame, encode
from runtime.commission.protocol import (
    CLEAR,
    DONE,
    DRAIN,
    ENDED,
    EVENT,
    GATES_OFF,
    HELLO,
    IDLE,
    RUNNING,
    SEGMENT,
    START,
    STIFF,
    Run,
    Segment,
    read_hello,
)
from runtime.estimator.compiler import build_library
from runtime.estimator.folder import GENERATED
from tests.codegen.strict import STRICT, need

HERE = Path(__file__).parent
FOLDER = GENERATED / "paper_spmsm"
PERIOD, CURRENT, SPEED, SECONDS = 1e-4, 10.0, 1000.0, 1.0
BYTE, OVER_CURRENT, LINK, TIME, OVERFLOW = 1, 2, 3, 4, 5
TAKEN, LATCHED, BEYOND, UNKNOWN = range(4)


class Bench:
    """The board in a test's hands: bytes in, samples in, gates and bytes out."""

    def __init__(self, delay: int = 1) -> None:
        names = ("pmsm_link", "pmsm_telemetry", "pmsm_commission")
        sources = {f"{n}{end}": (FOLDER / "board" / f"{n}{end}").read_text() for n in names for end in (".c", ".h")}
        sources["pmsm_commission_talk.c"] = (FOLDER / "board" / "pmsm_commission_talk.c").read_text()
        sources["pmsm_port.h"] = (FOLDER / "pmsm_port.h").read_text()
        sources["bench.c"] = (HERE / "commission_bench.c").read_text()
        self.c: Any = ctypes.CDLL(str(build_library(sources, {})))
        self.c.bench_new.restype = ctypes.c_void_p
        self.c.bench_new.argtypes = [ctypes.c_float, ctypes.c_int, ctypes.c_float, ctypes.c_float, ctypes.c_float]
        self.c.pmsm_commission_step.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_float, ctypes.c_void_p]
        for name in ("pmsm_commission_poll", "bench_state", "bench_reason", "bench_segment"):
            getattr(self.c, name).argtypes = [ctypes.c_void_p]
        self.board = self.c.bench_new(PERIOD, delay, CURRENT, SPEED, SECONDS)
        self.sequence = 0
        self.duty = (ctypes.c_float * 3)()

    def step(self, a: float = 0.0, b: float = 0.0, link: float = 24.0) -> bool:
        """One interrupt and one turn of the main loop; the gates."""
        gates = self.c.pmsm_commission_step(self.board, (ctypes.c_float * 2)(a, b), link, self.duty)
        self.c.pmsm_commission_poll(self.board)
        return bool(gates)

    def poll(self) -> None:
        self.c.pmsm_commission_poll(self.board)

    @property
    def state(self) -> int:
        return int(self.c.bench_state(self.board))

    @property
    def reason(self) -> int:
        return int(self.c.bench_reason(self.board))

    @property
    def segment(self) -> int:
        return int(self.c.bench_segment(self.board))

    def send(self, data: bytes) -> None:
        self.c.bench_send(data, len(data))

    def frames(self) -> list[Frame]:
        buffer = ctypes.create_string_buffer(1 << 20)
        count = self.c.bench_received(buffer)
        return Decoder().feed(buffer.raw[:count])

    def ask(self, command: int, payload: bytes = b"") -> bytes:
        self.sequence += 1
        self.send(encode(Frame(self.sequence, command, payload)))
        for _ in range(4):
            self.poll()
        answers = [f for f in self.frames() if f.command == command | ANSWER and f.sequence == self.sequence]
        assert len(answers) == 1
        return answers[0].payload

    def start(self, segments: list[Segment], **changes: Any) -> int:
        verdicts = {self.ask(SEGMENT, segment.packed(k))[0] for k, segment in enumerate(segments)}
        if verdicts != {TAKEN}:
            return max(verdicts)
        run = {"current_limit": CURRENT, "link": (12.0, 30.0), "gains": (0.1, 0.001, 0.05, 0.0005)}
        run |= {"flux": 0.007, "inductance": 2e-4, "lost": 0.1, "fade": 0.5} | changes
        return self.ask(START, Run("test", tuple(segments), **run).packed())[0]  # type: ignore[arg-type]


#: A plan with every kind of segment.
PLAN = [
    Segment("offset", 50, 0.0, every=10, flags=GATES_OFF),
    Segment("align", 100, 4.0, ramp=50, flags=STIFF),
    Segment("turn", 100, 3.0, ramp=100, turn=2.0),
    Segment("waves", 64, 3.0, along=1.0, half=4, every=1),
    Segment("drain", 20, 2.0, ramp=20, flags=DRAIN),
    Segment("up", 100, 2.0, ramp=100, speed=200.0, every=7),
    Segment("hold", 100, 2.0, speed=200.0, every=7),
    Segment("down", 100, 0.0, ramp=100, flags=DRAIN),
]


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_a_plan_runs_to_its_end_and_tells_every_row(bench: Bench) -> None:
    hello = read_hello(bench.ask(HELLO))
    assert hello is not None
    assert (hello.state, hello.current, hello.seconds) == (IDLE, CURRENT, SECONDS)
    assert hello.period == pytest.approx(PERIOD)
    assert bench.start(PLAN) == TAKEN
    gates = []
    while bench.state == RUNNING:
        gates.append(bench.step())
    assert not any(gates[:50])
    assert all(gates[51:-1])
    assert not gates[-1]
    for _ in range(100):
        bench.poll()
        assert not bench.step()
    frames = [f for f in bench.frames() if f.command in {0xE0, EVENT}]
    assert [f.sequence for f in frames] == list(range(len(frames)))
    begun = [f.payload[2] for f in frames if f.command == EVENT]
    assert begun == [0, 3, 5, 6, 7]  # those with rows, and the end
    assert frames[-1].payload[:2] == bytes([DONE, 0])
    assert sum(f.command == 0xE0 for f in frames) == 5 + 64 + 14 + 14


@pytest.mark.parametrize("seed", range(40))
def test_any_byte_at_any_instant_ends_it(bench: Bench, seed: int) -> None:
    """Drawn over all instants of the plan and all bytes: from the next interrupt on the gates are off, for good."""
    rng = np.random.default_rng(seed)
    assert bench.start(PLAN) == TAKEN
    for _ in range(int(rng.integers(0, 600))):
        bench.step()
    assert bench.state == RUNNING
    where = bench.segment
    bench.send(bytes([int(rng.integers(0, 256)) if seed % 4 else 0]))  # a zero is a byte, too
    bench.poll()
    assert not any(bench.step() for _ in range(300)), f"gates on after a byte in segment {where}"
    assert (bench.state, bench.reason) == (ENDED, BYTE)
    assert list(bench.duty) == [0.5] * 3
    assert bench.start(PLAN) == LATCHED
    assert not bench.step()
    assert bench.ask(CLEAR)[0] == TAKEN
    assert bench.start(PLAN) == TAKEN


NO_NUMBERS = [math.nan, math.inf, -math.inf]


@pytest.mark.parametrize(
    ("currents", "link", "reason"),
    [
        *[((a, 0.0), 24.0, OVER_CURRENT) for a in (10.1, -10.1, *NO_NUMBERS)],
        *[((0.0, b), 24.0, OVER_CURRENT) for b in (10.1, -10.1, *NO_NUMBERS)],
        ((6.0, 6.0), 24.0, OVER_CURRENT),  # the third phase carries what flows in both
        *[((0.0, 0.0), link, LINK) for link in (11.9, 30.1, 0.0, -24.0, *NO_NUMBERS)],
    ],
)
@pytest.mark.parametrize("after", [3, 70, 480])
def test_what_is_beyond_a_limit_switches_off_at_once(
    bench: Bench, currents: tuple[float, float], link: float, reason: int, after: int
) -> None:
    assert bench.start(PLAN) == TAKEN
    for _ in range(after):
        bench.step()
    assert not bench.step(*currents, link)
    assert (bench.state, bench.reason) == (ENDED, reason)
    assert not any(bench.step() for _ in range(50))
    assert bench.start(PLAN) == LATCHED


def test_a_current_just_within_goes_on(bench: Bench) -> None:
    assert bench.start(PLAN) == TAKEN
    for _ in range(60):
        bench.step()
    assert bench.step(9.9, -4.9)


def test_a_line_that_takes_nothing_ends_it_by_time_or_memory(bench: Bench) -> None:
    assert bench.start(PLAN[:5]) == TAKEN  # it waits for its rows to leave
    bench.c.bench_line(0)
    steps = 0
    while bench.state == RUNNING:
        bench.step()
        steps += 1
    assert bench.reason == TIME
    assert steps == pytest.approx(SECONDS / PERIOD, abs=2)
    other = Bench()
    assert other.start([Segment("waves", 1000, 1.0, every=1)]) == TAKEN
    other.c.bench_line(0)
    while other.state == RUNNING:
        other.step()
    assert other.reason == OVERFLOW


BAD_SEGMENTS = [
    Segment("x", 100, 10.1),
    Segment("x", 100, -10.1),
    Segment("x", 100, math.nan),
    Segment("x", 100, 1.0, speed=1001.0, ramp=100),
    Segment("x", 100, 1.0, speed=math.inf, ramp=100),
    Segment("x", 100, 1.0, turn=7.0),
    Segment("x", 100, 1.0, turn=6.0),  # in one sample: faster than anything
    Segment("x", 0, 1.0, ramp=1),
    Segment("x", 100, 1.0, ramp=0),
    Segment("x", 100, 1.0, ramp=101),
    Segment("x", 100, 1.0, along=math.nan, half=4),
    Segment("x", 20_000, 1.0),  # longer than a plan may last
]


@pytest.mark.parametrize("segment", BAD_SEGMENTS)
def test_a_plan_beyond_the_limits_is_refused(bench: Bench, segment: Segment) -> None:
    assert bench.start([segment]) == BEYOND
    assert not bench.step()
    assert bench.state == IDLE


@pytest.mark.parametrize(
    "changes",
    [
        {"current_limit": 10.1},
        {"current_limit": 0.0},
        {"current_limit": math.nan},
        {"link": (0.0, 30.0)},
        {"link": (30.0, 12.0)},
        {"link": (12.0, math.nan)},
        {"gains": (-0.1, 0.0, 0.0, 0.0)},
        {"gains": (0.1, math.nan, 0.0, 0.0)},
        {"flux": math.inf},
        {"fade": 0.0},
        {"lost": math.nan},
    ],
)
def test_a_start_with_senseless_numbers_is_refused(bench: Bench, changes: dict[str, Any]) -> None:
    assert bench.start(PLAN, **changes) == BEYOND
    assert not bench.step()


def test_a_place_beyond_the_plan_and_a_wrong_length_are_refused(bench: Bench) -> None:
    assert bench.ask(SEGMENT, PLAN[0].packed(40))[0] == BEYOND
    assert bench.ask(SEGMENT, PLAN[0].packed(0)[:-1])[0] == UNKNOWN
    assert bench.ask(START, b"\1")[0] == UNKNOWN
    assert bench.ask(0x30)[0] == UNKNOWN


def test_noise_on_the_line_never_switches_on(bench: Bench) -> None:
    """Random bytes, and damaged frames of a start: without a whole start the gates stay off."""
    rng = np.random.default_rng(1)
    for k, segment in enumerate(PLAN[1:]):
        bench.ask(SEGMENT, segment.packed(k))
    whole = encode(Frame(99, START, struct.pack("<B11f", 7, 10.0, 12.0, 30.0, 0.1, 0, 0, 0, 0, 0, 0, 1.0)))
    for _ in range(300):
        data = bytearray(rng.integers(0, 256, 40, dtype=np.uint8).tobytes() if rng.random() < 0.5 else whole)
        if bytes(data) == whole:
            place = int(rng.integers(1, len(data) - 1))
            data[place] ^= 1 << int(rng.integers(0, 8))
        bench.send(bytes(data))
        for _ in range(5):
            assert not bench.step()
        assert bench.state == IDLE
    bench.send(whole)
    for _ in range(4):
        bench.poll()
    assert bench.step()  # undamaged it would have done so


def test_voltages_stay_within_the_link_and_duties_within_one(bench: Bench) -> None:
    """A current that never comes winds nothing up beyond what the link gives."""
    assert bench.start(PLAN, gains=(5.0, 0.5, 5.0, 0.5)) == TAKEN
    while bench.state == RUNNING:
        bench.step(0.0, 0.0)
        duty = np.array(bench.duty)
        assert np.all((duty >= 0.02) & (duty <= 0.98))
    rows = [struct.unpack("<fI6f", f.payload) for f in bench.frames() if f.command == 0xE0]
    sizes = [math.hypot(row[2], row[3]) for row in rows]
    assert max(sizes) == pytest.approx(0.95 * 24.0 / math.sqrt(3), rel=1e-3)


@pytest.mark.parametrize("name", ["pmsm_commission", "pmsm_commission_talk"])
def test_it_compiles_with_a_16_bit_int(name: str, tmp_path: Path) -> None:
    """An int of 16 bits, as on the C28x, and every warning an error."""
    flags = [*STRICT, "-mmcu=atmega1284p", "-Os", f"-I{FOLDER}", f"-I{FOLDER / 'board'}"]
    source = FOLDER / "board" / f"{name}.c"
    command = [need("avr-gcc"), *flags, "-c", str(source), "-o", str(tmp_path / "c.o")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
