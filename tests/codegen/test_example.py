"""The example interrupt: both variants are strict C89, run with stubs for the hardware, and do what they say.

With the generated filter first, then with a scripted one (`board.c`). What its modes do is in test_modes_start,
test_modes_read, test_modes_run and test_modes_rival.
"""

from __future__ import annotations

import math
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from model.loop.injection import injected_voltage
from model.schema import Drive
from runtime.estimator.folder import GENERATED
from tests.codegen.board import Board
from tests.codegen.modes import (
    BLIND,
    BOARDS,
    DIVERGED,
    LOCKED,
    NOT_CONVERGED,
    PROBE,
    REJECTED,
    REPAIRED,
    REST,
    SETTLE,
    TRIP,
    ampere,
    guessed,
    rate,
    running,
    set_up,
    spin,
    stops,
)
from tests.codegen.strict import STRICT

#: Hardware that is not there. The example's own text is included, so that its state can be looked at.
STUBS = """
#include <stdio.h>
#include "example_isr.c"

static int acknowledged, off, on, sent, k;
static float32 current, last_duty[3], last_word;
int main(void);

void read_phase_currents(float32 phase[2]) { phase[0] = current; phase[1] = -0.5f * current; }
float32 read_dc_link(void) { return 300.0f; }
float32 read_speed_reference(void) { return 10.0f; }
void write_duty(const float32 duty[3]) { int j; for (j = 0; j < 3; j++) { last_duty[j] = duty[j]; } }
void acknowledge_interrupt(void) { acknowledged++; }
void inverter_off(void) { off++; }
void inverter_on(void) { on++; }
void telemetry(const float32 *words, int count) { sent += count; last_word = words[1]; }
void your_current_loop(const float32 i[2], float32 speed, float32 theta_pu, float32 share, int anew,
                       float32 v[2])
{
    (void)i; (void)speed; (void)theta_pu; (void)share; (void)anew;
    v[0] = (float32)k;
    v[1] = 0.0f;
}
void your_svgen(const float32 v[2], float32 dc_link, float32 duty[3])
{
    duty[0] = 0.5f + v[0] / dc_link; duty[1] = 0.5f; duty[2] = 0.5f;
}

"""

MAIN = """
int main(void)
{
    float32 zero = 0.0f;
    int good = motor_setup();
    if (good != 0) { printf("setup %d\\n", good); return 0; }
    current = 5.0f; /* a sensor that does not read zero while the inverter is off */
    for (k = 0; k < 2 * REST; k++) { adc_isr(); }
    printf("%d %d %d\\n", SUPERVISOR.mode, off, on);
    current = 0.1f; /* as good as zero; and zero voltage makes no more of it: the rotor stands */
    for (k = 0; k < REST + PROBE; k++) { adc_isr(); }
    printf("%d %d %d\\n", SUPERVISOR.mode, off, on);
    acknowledged = 0;
    off = 0;
    for (k = 1; k <= 5; k++) {
        adc_isr();
        printf("%g %g %g %g\\n", (double)FILTER.u_held[0], (double)last_duty[0], (double)last_duty[1],
               (double)last_duty[2]);
    }
    current = zero / zero;
    for (k = 1; k < BLIND; k++) { adc_isr(); }
    printf("%d %d\\n", acknowledged == BLIND + 4, off);
    adc_isr();
    printf("%d\\n", off);
    current = 0.1f;
    for (k = 0; k < TELEMETRY_EVERY; k++) { adc_isr(); }
    good = sent >= 5 && sent % 5 == 0 && last_word >= 0.0f && last_word < 1.0f;
    printf("%d %g %g\\n", good, (double)per_unit(-0.1f), (double)per_unit(3.0f));
    return 0;
}
"""


def _run(folder: Path, drive: Drive, kind: str, build: Path, variant: int) -> list[list[float]]:
    main = build / "main.c"
    main.write_text(STUBS + MAIN)
    p = f"{drive.name}_{kind}"
    parts = [folder / f"{p}{end}.c" for end in ("", "_foc", "_supervisor", "_drive", "_selftest", "_foc_selftest")]
    times = {"REST": REST, "PROBE": PROBE, "BLIND": BLIND}
    given = [f"-D{name}={round(seconds / drive.model.sample_time)}" for name, seconds in times.items()]
    command = ["gcc", *STRICT, "-O2", f"-DWHOLE_CONTROLLER={variant}", *given, f"-I{folder}", str(main)]
    command += map(str, parts)
    subprocess.run([*command, "-o", str(build / "e"), "-lm"], check=True, capture_output=True, text=True)
    lines = subprocess.run([build / "e"], check=True, capture_output=True, text=True).stdout.splitlines()
    return [[float(word) for word in line.split() if word != "setup"] for line in lines]


@pytest.mark.parametrize("variant", [0, 1])
def test_runs_with_stubs(drive: Drive, variant: int, tmp_path: Path) -> None:
    lines = _run(GENERATED / drive.name, drive, "ickf", tmp_path, variant)
    waiting, started, *steps = lines[:7]
    (all_acknowledged, early), (late,), (telemetry_good, *turns) = lines[7:]
    rest, rivals = round(REST / drive.model.sample_time), drive.model.sample_time >= 50e-6
    assert waiting == [0, 1 + 2 * rest, 0], "RESTING; turned off at power-up and at every interrupt since"
    assert started == [6 if rivals else 4, 3 * rest, 1], "STARTING or RUNNING; turned on once"
    if not variant:  # the stub's voltage is the number of the interrupt: the filter gets it two interrupts later
        assert [row[0] for row in steps] == [0, 0, 1, 2, 3]
    assert all(0 <= duty <= 1 for row in steps for duty in row[1:])
    assert all_acknowledged == 1
    assert (early, late) == (0, 1), "blind for 2 ms, and not before"
    assert telemetry_good == 1
    assert turns == pytest.approx([1 - 0.1 / 6.283185, 3 / 6.283185], abs=1e-6)


def test_a_failed_self_test_keeps_the_motor_off(drive: Drive, tmp_path: Path) -> None:
    folder = tmp_path / "f"
    folder.mkdir()
    for path in (GENERATED / drive.name).glob("*.[ch]"):
        text = path.read_text()
        if path.name == f"{drive.name}_ickf.c":
            text = re.sub(r"(#define GAIN_\w+ )(\S+f /\* )", r"\1 1.5f * \2", text, count=1)
        (folder / path.name).write_text(text)
    ((code,),) = _run(folder, drive, "ickf", tmp_path, 1)
    assert code <= -100


# --- with a scripted filter


@pytest.fixture(params=BOARDS, ids=lambda item: f"{item[0]}-{item[1]}")
def board(request: pytest.FixtureRequest) -> Iterator[Board]:
    with set_up(*request.param) as made:
        yield made


def test_gates_are_told_off_at_every_interrupt_and_on_once(board: Board) -> None:
    for _ in range(board.interrupts(REST) - 1):
        assert board.interrupt(phase=(0.0, 0.0)).count("0") == 1
        assert "1" not in board.events
    assert board.interrupt().count("1") == 1
    assert board.setup() == 0
    running(board)
    for _ in range(2 * board.interrupts(LOCKED)):
        events = board.interrupt()
        assert "1" not in events
        assert "0" not in events
    assert stops(board, 5, phase=(1.01 * ampere(board, TRIP), 0.0)) == 3
    for _ in range(5):
        assert board.interrupt().count("0") == 1


def test_each_sample_reads_steps_writes_and_acknowledges(board: Board) -> None:
    running(board)
    spin(board, 1, board.drive.operating_box.speed)  # beyond what a square wave at standstill is added to
    events = board.interrupt(phase=(0.2, 0.3), duty_wanted=(0.1, 0.2, 0.3)).replace("t", "")
    assert events == ("pswa" if board.variant else "pslvwa")
    waved = board.variant and injected_voltage(board.drive)  # duty cycles are centred even where no wave is left
    centred = 0.3 if waved else 0.0
    assert list(board.now.duty) == pytest.approx([0.1 + centred, 0.2 + centred, 0.3 + centred])
    if board.variant:
        assert list(board.now.y) == pytest.approx([0.2, 0.3])
        assert list(board.now.command) == pytest.approx([board.now.reference, board.now.link])
    else:
        i = [0.2, (0.2 + 2 * 0.3) / math.sqrt(3)]
        assert list(board.now.y) == pytest.approx(i)
        spin(board, 1, 12.5)
        board.now.theta = -0.1
        board.interrupt(v_wanted=(5.0, -6.0))
        assert list(board.now.loop) == pytest.approx([*i, 12.5, 1 - 0.1 / (2 * math.pi)], rel=1e-5)
        assert list(board.now.svgen) == pytest.approx([5.0, -6.0, board.now.link])


def test_the_filter_gets_the_voltage_of_two_interrupts_ago(board: Board) -> None:
    if board.variant:
        return
    running(board)
    given = []
    for k in range(6):
        board.interrupt(v_wanted=(float(k + 1), float(-k - 1)))
        given.append(tuple(board.now.u))
    assert given == [(0.0, 0.0), (0.0, 0.0), (1.0, -1.0), (2.0, -2.0), (3.0, -3.0), (4.0, -4.0)]


def test_telemetry_is_five_words_50_times_a_second(board: Board) -> None:
    every = board.interrupts(1 / 50)
    assert board.until("t", 2 * every, phase=(1e6, 0.0)) == every, "from power-up on"
    assert board.now.word_count == 5
    assert list(board.now.words)[3:5] == [0, 0]
    running(board)
    omega = rate(board, LOCKED, 0.5)
    board.now.theta = 0.0
    assert spin(board, every, omega, status=NOT_CONVERGED, stop="t")
    passed = spin(board, 2 * every, omega, status=REPAIRED, stop="t")
    assert passed == every
    words = list(board.now.words)[:5]
    assert board.mode == "RUNNING"
    turns = board.now.theta / (2 * math.pi) % 1.0
    hertz = omega * board.drive.motor.pole_pairs / (2 * math.pi)
    assert words == pytest.approx([omega, turns, hertz, REPAIRED, board.module.RUNNING], rel=1e-4, abs=1e-6)
    for theta, turn in ((-0.1, 1 - 0.1 / (2 * math.pi)), (3.0, 3.0 / (2 * math.pi)), (0.0, 0.0)):
        board.setup()
        running(board)
        assert spin(board, every, 0.0, stop="t")
        spin(board, every - 1, 0.0)
        assert "t" in board.interrupt(theta=theta), "and this is where the angle is by then"
        assert list(board.now.words)[1] == pytest.approx(turn, abs=1e-6)


# --- power-up


def test_a_failed_self_test_is_told_and_nothing_enabled(board: Board) -> None:
    assert board.setup(filter_code=1203) == -1203
    assert "1" not in board.events
    for acknowledged in (0, 1):
        board.keep("acknowledged", acknowledged)
        for _ in range(3 * board.interrupts(REST)):
            events = board.interrupt(phase=(0.0, 0.0))
            assert "0" in events
            assert "s" not in events
        assert (board.mode, board.reason) == ("FAULT", "SELF_TEST"), "which no acknowledgement leaves"
    assert board.setup() == 0
    assert board.events.startswith("0")
    assert next(iter(board.now.tolerance)) == 0.0, "this host has IEEE division and root: bits"
    if board.variant:
        assert board.events == "0fc"
        assert board.setup(controller_code=411) == 411
        assert "1" not in board.events
        assert board.setup(filter_code=7, controller_code=411) == -7
        assert list(board.now.tolerance) == [0.0, 0.0]
    else:
        assert board.events == "0f"


def test_power_up_begins_anew_whatever_went_before(board: Board) -> None:
    running(board)
    board.interrupt(10)
    assert board.setup() == 0
    assert not board.gates
    assert "s" not in board.interrupt()
    assert board.until("t", 10 * board.interrupts(1 / 50)) == board.interrupts(1 / 50) - 1


@pytest.mark.parametrize("code", [0, 1203])
@pytest.mark.parametrize(
    ("status", "counted"), [(0, set()), (REJECTED | DIVERGED, {"rejected", "diverged"})], ids=["good", "bad"]
)
def test_a_second_power_up_forgets_what_was_counted(board: Board, status: int, counted: set[str], code: int) -> None:
    """In the middle of a catch that was turned round, with a current beyond the limit for one sample."""
    omega = guessed(board)
    spin(board, 2 * board.interrupts(SETTLE), omega, ratio=-1.0, status=status)
    board.interrupt(phase=(1.01 * ampere(board, TRIP), 0.0))
    assert board.gates
    usual = {"mode", "inverter", "runs", "ticks", "since", "readings", "excess", "mirrored"}
    assert board.counted() == usual | (counted or {"content"})
    assert board.setup(filter_code=code) == -code
    assert not board.gates
    assert board.counted() == ({"mode", "reason"} if code else set())
