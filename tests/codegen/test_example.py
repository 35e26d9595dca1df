"""The example interrupt: both variants are strict C89, run with stubs for the hardware, and do what they say."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from model.schema import Drive
from runtime.estimator.folder import GENERATED
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
void your_current_loop(const float32 i[2], float32 speed, float32 theta_pu, int torque, float32 v[2])
{
    (void)i; (void)speed; (void)theta_pu; (void)torque;
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
    printf("%d %d %d\\n", mode, off, on);
    current = 0.1f; /* as good as zero; and zero voltage makes no more of it: the rotor stands */
    for (k = 0; k < REST + PROBE; k++) { adc_isr(); }
    printf("%d %d %d\\n", mode, off, on);
    acknowledged = 0;
    off = 0;
    for (k = 1; k <= 5; k++) {
        adc_isr();
        printf("%g %g %g %g\\n", (double)FILTER.u_held[0], (double)last_duty[0], (double)last_duty[1],
               (double)last_duty[2]);
    }
    current = zero / zero;
    for (k = 0; k < MAX_REJECTED; k++) { adc_isr(); }
    printf("%d %d\\n", acknowledged == MAX_REJECTED + 5, off);
    adc_isr();
    printf("%d\\n", off);
    current = 0.1f;
    for (k = 0; k < TELEMETRY_EVERY; k++) { adc_isr(); }
    good = sent >= 4 && sent % 4 == 0 && last_word >= 0.0f && last_word < 1.0f;
    printf("%d %g %g\\n", good, (double)per_unit(-0.1f), (double)per_unit(3.0f));
    return 0;
}
"""


def _run(folder: Path, drive: str, kind: str, build: Path, variant: int) -> list[list[float]]:
    main = build / "main.c"
    main.write_text(STUBS + MAIN)
    p = f"{drive}_{kind}"
    parts = [folder / f"{p}{end}.c" for end in ("", "_foc", "_selftest", "_foc_selftest")]
    command = ["gcc", *STRICT, "-O2", f"-DWHOLE_CONTROLLER={variant}", f"-I{folder}", str(main), *map(str, parts)]
    subprocess.run([*command, "-o", str(build / "e"), "-lm"], check=True, capture_output=True, text=True)
    lines = subprocess.run([build / "e"], check=True, capture_output=True, text=True).stdout.splitlines()
    return [[float(word) for word in line.split() if word != "setup"] for line in lines]


@pytest.mark.parametrize("variant", [0, 1])
def test_runs_with_stubs(drive: Drive, variant: int, tmp_path: Path) -> None:
    lines = _run(GENERATED / drive.name, drive.name, "ickf", tmp_path, variant)
    waiting, started, *steps = lines[:7]
    (all_acknowledged, early), (late,), (telemetry_good, *turns) = lines[7:]
    assert waiting == [0, 1, 0], "RESTING; turned off at power-up, and not on"
    assert started == [3, 1, 1], "RUNNING; turned on once"
    if not variant:  # the stub's voltage is the number of the interrupt: the filter gets it two interrupts later
        assert [row[0] for row in steps] == [0, 0, 1, 2, 3]
    assert all(0 <= duty <= 1 for row in steps for duty in row[1:])
    assert all_acknowledged == 1
    assert (early, late) == (0, 1), "blind for MAX_REJECTED samples, and then one more"
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
    ((code,),) = _run(folder, drive.name, "ickf", tmp_path, 1)
    assert code <= -100
