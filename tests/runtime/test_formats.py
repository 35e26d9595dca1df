"""Recordings as instruments, firmware tools and simulators write them: each reads as the same numbers.

Every file here is made by hand in the style of the real thing; the source of the style stands beside it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.recorded.data import Corrections, read_recorded
from runtime.system.errors import UserError

pytestmark = pytest.mark.unit

N, T = 60, 1e-4
rng = np.random.default_rng(17)
TIME = 0.1 + T * np.arange(N)
I_A, I_B = rng.normal(size=(2, N)).round(5)
U_AB, U_BC = (40 * rng.normal(size=(2, N))).round(4)
I_C, U_CA = -I_A - I_B, -U_AB - U_BC
U_A, U_B, U_C = (U_AB - U_CA) / 3, (U_BC - U_AB) / 3, (U_CA - U_BC) / 3
#: The textbook's projections on the axes.
ALPHA_BETA = {
    "u": np.column_stack([U_A, (U_B - U_C) / np.sqrt(3)]),
    "i": np.column_stack([I_A, (I_B - I_C) / np.sqrt(3)]),
}
LINES = (TIME, U_AB, U_BC, I_A, I_B)


def rows(*columns: Any, separator: str = ",", end: str = "\n", number: str = "{:.9g}", last: str = "") -> str:
    return "".join(
        separator.join(number.format(cell) for cell in row) + last + end for row in zip(*columns, strict=True)
    )


def channels(*names: str) -> tuple[str, ...]:
    return tuple(f"{theirs}={ours}" for theirs, ours in zip(names, ("t", "u_ab", "u_bc", "i_a", "i_b"), strict=True))


def scope_names(prefix: str, first: int = 1) -> tuple[str, ...]:
    return tuple(f"{prefix}{k}" for k in range(first, first + 4))


#: Style: text, --rename, other corrections.
Style = tuple[str, tuple[str, ...], Corrections]
PLAIN = Corrections()
STYLES: dict[str, Style] = {
    # Keysight InfiniiVision, "CSV data" of the front panel: names that are numbers, units in the second row.
    "Keysight": (
        "x-axis,1,2,3,4\nsecond,Volt,Volt,Ampere,Ampere\n" + rows(*LINES, number="{:+.9E}"),
        channels("x-axis", "1", "2", "3", "4"),
        PLAIN,
    ),
    # Rigol DS1000Z: an index, start and increment in the header; rows end with a comma and are shorter than the header.
    "Rigol with an index": (
        f"X,CH1,CH2,CH3,CH4,Start,Increment,\nSequence,Volt,Volt,Ampere,Ampere,{TIME[0]:.6e},{T:.6e}\n"
        + rows(range(N), *LINES[1:], last=","),
        channels("X", *scope_names("CH")),
        PLAIN,
    ),
    "Rigol, one row of padding": (
        f"X,CH1,CH2,CH3,CH4,Start,Increment\nSequence,Volt,Volt,Ampere,Ampere,{TIME[0]:.6e},{T:.6e}\n"
        + rows(range(N), *LINES[1:], last=",,"),
        channels("X", *scope_names("CH")),
        PLAIN,
    ),
    # Rigol MSO5000 and DHO: no time at all, t0 and tInc among the names.
    "Rigol without times": (
        f"CH1V,CH2V,CH3V,CH4V,t0 ={TIME[0]:e}s, tInc = {T:e},\n" + rows(*LINES[1:], last=",,"),
        channels("t", *(f"CH{k}V" for k in range(1, 5))),
        PLAIN,
    ),
    "Rigol from the screen": (
        "Time(s),CH1V,CH2V,CH3V,CH4V\n" + rows(*LINES),
        channels("Time", *(f"CH{k}V" for k in range(1, 5))),
        PLAIN,
    ),
    # PicoScope 6 and 7: names, units in brackets, an empty line.
    "PicoScope": (
        "Time,Channel A,Channel B,Channel C,Channel D\n(ms),(V),(mV),(A),(mA)\n\n"
        + rows(1e3 * TIME, U_AB, 1e3 * U_BC, I_A, 1e3 * I_B),
        channels("Time", *(f"Channel {letter}" for letter in "ABCD")),
        PLAIN,
    ),
    # Saleae Logic 2, raw analog data; probes with factors come by --scale.
    "Saleae": (
        "Time [s],Channel 0,Channel 1,Channel 2,Channel 3\n" + rows(*LINES, number="{:.12g}"),
        channels("Time", *scope_names("Channel ", 0)),
        PLAIN,
    ),
    # VESC Tool, Sampled Data, "Save CSV" (pages/pagesampleddata.cpp): a semicolon ends every row, no line end the last.
    "VESC Tool, sampled data": (
        "T;I1;I2;I3;V1;V2;V3;I_tot;V_zero;Phase\n"
        + rows(
            TIME, I_A, I_B, I_C, U_A + 12, U_B + 12, U_C + 12, I_A, 0 * TIME + 12, 0 * TIME, separator=";", last=";"
        )[:-1],
        ("T=t", "I1=i_a", "I2=i_b", "I3=i_c", "V1=u_a", "V2=u_b", "V3=u_c", "Phase=theta"),
        PLAIN,
    ),
    # ODrive's BulkCapture (tools/odrive/utils.py) through numpy.savetxt: no header; phases B and C are measured.
    "ODrive, saved by NumPy": (
        rows(TIME, ALPHA_BETA["u"][:, 0], ALPHA_BETA["u"][:, 1], I_B, I_C, separator=" ", number="{:.18e}"),
        ("1=t", "2=u_alpha", "3=u_beta", "4=i_b", "5=i_c"),
        PLAIN,
    ),
    "ODrive, dotted names": (
        "time,axis0.motor.current_control.final_v_alpha,axis0.motor.current_control.final_v_beta,"
        "axis0.motor.current_meas_phB,axis0.motor.current_meas_phC\n" + rows(TIME, *ALPHA_BETA["u"].T, I_B, I_C),
        (
            "time=t",
            "axis0.motor.current_control.final_v_alpha=u_alpha",
            "axis0.motor.current_control.final_v_beta=u_beta",
            "axis0.motor.current_meas_phB=i_b",
            "axis0.motor.current_meas_phC=i_c",
        ),
        PLAIN,
    ),
    # PLECS, "Export as CSV" of a scope; Simulink's Data Inspector quotes in the same way.
    "PLECS": (
        '"Time / s","Line voltages:1","Line voltages:2","Stator currents:1","Stator currents:2"\n' + rows(*LINES),
        channels("Time / s", "Line voltages:1", "Line voltages:2", "Stator currents:1", "Stator currents:2"),
        PLAIN,
    ),
    # Ansys Twin Builder, "CSV file format": names with units in quotes, a blank after the comma.
    "Twin Builder": (
        '"Time [ms]", "AB.V [V]", "BC.V [V]", "A.I [mA]", "B.I [A]"\n' + rows(1e3 * TIME, U_AB, U_BC, 1e3 * I_A, I_B),
        channels("Time", "AB.V", "BC.V", "A.I", "B.I"),
        PLAIN,
    ),
    # LTspice, "Export data as text": a function's argument is no unit, not even where it is a letter of one.
    "SPICE": (
        "time\tV(ab)\tV(bc)\tI(A)\tI(V)\n" + rows(*LINES, separator="\t", number="{:.9e}"),
        channels("time", "V(ab)", "V(bc)", "I(A)", "I(V)"),
        PLAIN,
    ),
    # German spreadsheets and DIN 1313: quantity / unit; numbers with a comma within quotes.
    "unit after a stroke": (
        "Zeit/s;U_ab / V;U_bc in mV;I_a / mA;I_b_mA\n"
        + rows(TIME, U_AB, 1e3 * U_BC, 1e3 * I_A, 1e3 * I_B, separator=";").replace(".", ","),
        channels("Zeit/s", "U_ab / V", "U_bc in mV", "I_a / mA", "I_b_mA"),
        PLAIN,
    ),
    "quoted names and numbers with commas": (
        '"Time, s","Uab, V","Ubc, V","Ia, A","Ib, mA"\n'
        + "".join(
            ",".join('"' + f"{cell:.9g}".replace(".", ",") + '"' for cell in row) + "\n"
            for row in zip(TIME, U_AB, U_BC, I_A, 1e3 * I_B, strict=True)
        ),
        channels("Time, s", "Uab, V", "Ubc, V", "Ia, A", "Ib, mA"),
        PLAIN,
    ),
    # Tektronix TDS: settings in the first columns of the first rows.
    "settings beside the numbers": (
        "".join(
            ("Record Length,2500," if k == 0 else "Sample Interval,1e-4," if k == 1 else ",,") + line + "\n"
            for k, line in enumerate(rows(*LINES).splitlines())
        ),
        ("3=t", "4=u_ab", "5=u_bc", "6=i_a", "7=i_b"),
        PLAIN,
    ),
    "other pairs of lines": (
        "t,u_bc,u_ca,i_a,i_c\n" + rows(TIME, U_BC, U_CA, I_A, I_C),
        (),
        PLAIN,
    ),
    "duty cycles": (
        "t,duty_a,duty_b,duty_c,v_dc,i_a,i_b\n"
        + rows(TIME, *(0.5 + u / 311 for u in (U_A, U_B, U_C)), 0 * TIME + 311, I_A, I_B),
        (),
        PLAIN,
    ),
    "duty cycles in per cent, a constant link": (
        "t (s),duty_a (%),duty_b (%),duty_c (%),i_a (A),i_b (A)\n"
        + rows(TIME, *(50 + 100 * u / 311 for u in (U_A, U_B, U_C)), I_A, I_B),
        (),
        Corrections(dc_link=311.0),
    ),
    "an offset of a sensor": (
        "t,u_ab,u_bc,i_a,i_b\n" + rows(TIME, U_AB, U_BC, I_A + 0.125, 1e3 * I_B),
        (),
        Corrections(offsets=["i_a=-0.125", "i_b=0A"]),
    ),
    "sensors in another order": (
        "t,u_ab,u_bc,i_a,i_b,i_c\n" + rows(TIME, U_AB, U_BC, -I_C, -I_A, -I_B),
        (),
        Corrections(wiring="-cab"),
    ),
}


@pytest.mark.parametrize("style", STYLES)
def test_every_style_reads_as_the_same_numbers(style: str, tmp_path: Path) -> None:
    text, renames, corrections = STYLES[style]
    path = tmp_path / "scope.csv"
    path.write_text(text, encoding="utf-8")
    scales = ["i_b=mA"] if style == "an offset of a sensor" else []
    found = read_recorded(path, renames, scales, corrections=corrections)
    np.testing.assert_allclose(found.t, TIME, atol=1e-9)
    np.testing.assert_allclose(found.u, ALPHA_BETA["u"], atol=2e-5)
    np.testing.assert_allclose(found.y, ALPHA_BETA["i"], atol=2e-6)


MARKS = "∞", "-∞", "", "N/A", "#N/A", "-1.#IND", "1.#QNAN0", "-nan(ind)", "---", "****", "OVER", "nan"


@pytest.mark.parametrize("mark", MARKS)
@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_mark_of_a_missing_sample_is_not_a_number(mark: str, separator: str, tmp_path: Path) -> None:
    body = [line.split(separator) for line in rows(*LINES, separator=separator).splitlines()]
    body[0][3], body[7][1], body[9][4] = mark, mark if separator == "\t" else f" {mark}", mark
    path = tmp_path / "scope.csv"

    def write() -> None:
        lines = [["t", "u_ab", "u_bc", "i_a", "i_b"], *body, [""] * 5]
        path.write_text("\n".join(separator.join(row) for row in lines), encoding="utf-8")

    write()
    found = read_recorded(path)
    assert len(found.t) == N, "a row of nothing is none"
    assert list(np.flatnonzero(np.isnan(found.y[:, 0]))) == [0]
    assert list(np.flatnonzero(np.isnan(found.u[:, 0]))) == [7]
    assert list(np.flatnonzero(np.isnan(found.y[:, 1]))) == [0, 9]
    body[9][4] = f"{mark}x"
    write()
    with pytest.raises(UserError, match=r"line 11, column 'i_b' is '.*x', not a number"):
        read_recorded(path)


def test_a_long_text_is_read_in_pieces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pieces that end anywhere: within a number, a line end, a comment, a letter of two bytes."""
    text = "t,u_ab,u_bc,i_a,i_b,note\r\n" + rows(*LINES, last=",µ", end="\r\n") + "# that was all\r\n"
    for size in (1, 7, 64, 1000):
        monkeypatch.setattr("runtime.recorded.cells.PIECE", size)
        for encoding in ("utf-8", "utf-8-sig", "utf-16", "latin-1"):
            path = tmp_path / "long.csv"
            path.write_bytes(text.encode(encoding))
            np.testing.assert_allclose(read_recorded(path).y, ALPHA_BETA["i"], atol=1e-6)
        path.write_text(text.replace(f"{I_A[40]:.9g}", "x", 1), encoding="utf-8", newline="")
        with pytest.raises(UserError, match="line 42, column 'i_a' is 'x'"):
            read_recorded(path)


REFUSED: dict[str, tuple[str, tuple[str, ...], Corrections, str]] = {
    # VESC Tool, realtime log: currents in d and q without an angle, twenty times a second.
    "VESC Tool, realtime log": (
        "ms_today;input_voltage;temp_mos_max;current_motor;current_in;d_axis_current;q_axis_current;erpm;duty_cycle\n"
        "1;24;30;1;0.5;0.1;1;1000;0.2\n51;24;30;1;0.5;0.1;1;1000;0.2\n",
        (),
        PLAIN,
        "Did you mean --rename input_voltage=u_dc",
    ),
    "d and q": (
        "t,id,iq,vd,vq\n0,0,0,0,0\n1e-4,0,0,0,0\n",
        (),
        PLAIN,
        "'id' lacks the angle it was turned by: record phase currents",
    ),
    "names that are near": (
        "T;I1;I2;I3;V1;V2;V3;I_tot\n0;0;0;0;0;0;0;0\n",
        (),
        PLAIN,
        "Did you mean --rename T=t --rename V1=u_a --rename V2=u_b --rename V3=u_c --rename I1=i_a",
    ),
    "no header": ("0 0 0 0 0\n1e-4 0 0 0 0\n", (), PLAIN, "name them by number: --rename 1=t"),
    "the same name twice": (
        "t,u_ab,u_bc,I,I\n" + rows(*LINES),
        ("I=i_a",),
        PLAIN,
        "has 'I' 2 times; say '#4=i_a' or '#5=i_a'",
    ),
    "duty cycles of a timer": (
        "t,duty_a,duty_b,duty_c,u_dc,i_a,i_b\n0,0,1800,3750,24,0,0\n1e-4,0,1800,3750,24,0,0\n",
        (),
        PLAIN,
        "reach from 0 to 3750, not from 0 to 1. If they are counts of a timer: --scale duty_a=1/COUNTS",
    ),
    "duty cycles in per cent": (
        "t,duty_a,duty_b,duty_c,u_dc,i_a,i_b\n0,10,50,90,24,0,0\n1e-4,10,50,90,24,0,0\n",
        (),
        PLAIN,
        "per cent: --scale duty_a=%",
    ),
    "modulation": (
        "t,duty_a,duty_b,duty_c,u_dc,i_a,i_b\n0,-0.3,0,0.9,24,0,0\n1e-4,-0.3,0,0.9,24,0,0\n",
        (),
        PLAIN,
        "a modulation of -1 .. 1: --scale duty_a=0.5",
    ),
    "no dc link": (
        "t,duty_a,duty_b,duty_c,i_a,i_b\n0,0,0,0,0,0\n",
        (),
        PLAIN,
        "lacks the column u_alpha, u_beta",
    ),
    "a dc link that is none": ("t\n", (), Corrections(dc_link=-1.0), "--dc-link -1 is no voltage"),
    "a wiring that is none": ("t\n", (), Corrections(wiring="abd"), "--wiring 'abd' is none of abc, acb"),
    "an offset that is none": (
        "t,u_ab,u_bc,i_a,i_b\n" + rows(*LINES),
        (),
        Corrections(offsets=["i_a=much"]),
        "is not a number such as -0.12",
    ),
    "an offset of another unit": (
        "t,u_ab,u_bc,i_a,i_b\n" + rows(*LINES),
        (),
        Corrections(offsets=["i_a=3V"]),
        "that is a unit of voltage",
    ),
    "an offset of nothing": (
        "t,u_ab,u_bc,i_a,i_b\n" + rows(*LINES),
        (),
        Corrections(offsets=["i_c=3"]),
        "has no 'i_c'",
    ),
    "one row, the voltage before it": (
        "t,u_ab,u_bc,i_a,i_b\n0,0,0,0,0\n",
        (),
        Corrections(begins=True),
        "of one row there is no voltage",
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_is_unlike_a_recording_is_one_line_with_advice(what: str, tmp_path: Path) -> None:
    text, renames, corrections, expected = REFUSED[what]
    (tmp_path / "d.csv").write_text(text)
    with pytest.raises(UserError) as caught:
        read_recorded(tmp_path / "d.csv", renames, corrections=corrections)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_modulation_is_taken_where_its_factor_is_said(tmp_path: Path) -> None:
    made = {name: 2 * u / 311 for name, u in zip(("duty_a", "duty_b", "duty_c"), (U_A, U_B, U_C), strict=True)}
    np.savez(tmp_path / "d.npz", t=TIME, i_a=I_A, i_b=I_B, u_dc=np.full(N, 311.0), **made)
    found = read_recorded(tmp_path / "d.npz", (), [f"{name}=0.5" for name in made])
    np.testing.assert_allclose(found.u, ALPHA_BETA["u"], atol=1e-9)


def test_voltages_of_the_interval_that_begins_move_to_its_end(tmp_path: Path) -> None:
    np.savez(tmp_path / "d.npz", t=TIME, u_ab=U_AB, u_bc=U_BC, i_a=I_A, i_b=I_B, theta=TIME)
    found = read_recorded(tmp_path / "d.npz", corrections=Corrections(begins=True))
    np.testing.assert_allclose(found.u, ALPHA_BETA["u"][:-1], atol=1e-9)
    np.testing.assert_allclose(found.y, ALPHA_BETA["i"][1:], atol=1e-9)
    np.testing.assert_array_equal(found.t, TIME[1:])
    np.testing.assert_array_equal(found.truth["theta"], TIME[1:])


def test_an_angle_by_its_cosine_and_sine(tmp_path: Path) -> None:
    theta = np.linspace(-3.0, 3.0, N)
    made = {"cos_theta": 2 * np.cos(theta), "sin_theta": 2 * np.sin(theta)}
    np.savez(tmp_path / "d.npz", t=TIME, u_ab=U_AB, u_bc=U_BC, i_a=I_A, i_b=I_B, **made)
    np.testing.assert_allclose(read_recorded(tmp_path / "d.npz").truth["theta"], theta)
