"""Recorded data: every dialect reads as the same numbers, and what is wrong with a file is said in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from runtime.recorded.clock import check_clock
from runtime.recorded.data import read_recorded, write_recorded
from runtime.system.errors import UserError

pytestmark = pytest.mark.unit

NAMES = ("t", "u_alpha", "u_beta", "i_alpha", "i_beta")
ROWS = np.column_stack([1e-4 * np.arange(20), np.random.default_rng(3).normal(size=(20, 4))]).round(6)


def lines(separator: str = ",", decimal: str = ".", quote: str = "", end: str = "\n", last: str = "") -> str:
    return "".join(
        separator.join(quote + f"{value:.9g}".replace(".", decimal) + quote for value in row) + last + end
        for row in ROWS
    )


PLAIN = ",".join(NAMES) + "\n"
DIALECTS = {
    "plain": (PLAIN + lines()).encode(),
    "byte order mark, CRLF": ("\ufeff" + PLAIN.replace("\n", "\r\n") + lines(end="\r\n")).encode(),
    "UTF-16": (PLAIN + lines()).encode("utf-16"),
    "old line ends": (PLAIN + lines(end="\n")).replace("\n", "\r").encode(),
    "semicolon, decimal comma": (PLAIN.replace(",", ";") + lines(";", ",")).encode(),
    "tab": (PLAIN.replace(",", "\t") + lines("\t")).encode(),
    "tab, decimal comma": (PLAIN.replace(",", "\t") + lines("\t", ",")).encode(),
    "blanks": (PLAIN.replace(",", "   ") + lines("  ")).encode(),
    "quotes": (",".join(f'"{name}"' for name in NAMES) + "\n" + lines(quote='"')).encode(),
    "comments": ("# a scope\n% of mine\n\n" + PLAIN + lines()[:60].rpartition("\n")[0] + "\n# a pause\n").encode()
    + lines().encode()[len(lines()[:60].rpartition("\n")[0]) + 1 :],
    "commented header": ("# " + PLAIN + lines()).encode(),
    "separator at the end": (PLAIN.strip() + ",\n" + lines(last=",")).encode(),
    "blank lines": (PLAIN + "\n" + lines(end="\n\n")).encode(),
    "lines before the header": ("Model,MDO\nRecord Length,20,Points\n\n" + PLAIN + lines()).encode(),
    "no last line end": (PLAIN + lines().rstrip()).encode(),
    "a column of words": (
        "when," + PLAIN + "".join("12:00:01," + line + "\n" for line in lines().splitlines())
    ).encode(),
    "SI units": ("t (s),u_alpha (V),u_beta [V],i_alpha(A),i_beta (A)\n" + lines()).encode(),
    "units below": (PLAIN + "s,V,V,(A),[A]\n\n" + lines()).encode(),
    "Latin-1": ("t,u_alpha,u_beta,i_alpha,i_beta,\xb0C\n" + lines(last=",20")).encode("latin-1"),
}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_every_dialect_reads_as_the_same_numbers(dialect: str, tmp_path: Path) -> None:
    path = tmp_path / "d.csv"
    path.write_bytes(DIALECTS[dialect])
    recorded = read_recorded(path)
    np.testing.assert_array_equal(np.column_stack([recorded.t, recorded.u, recorded.y]), ROWS)
    assert recorded.truth == {}
    assert recorded.notes == []


def test_units_in_a_header_are_converted_and_told(tmp_path: Path) -> None:
    path = tmp_path / "scope.csv"
    path.write_text(
        "Time (ms);Va (V);Vb (V);Ia [mA];Ib [mA];n (rpm);Theta (°);T (Nm)\n"
        "0,0;1;2;3000;4000;60;90;5\n0,1;1;2;3;4;60;180;5\n"
    )
    names = ("Time=t", "Va=u_alpha", "Vb=u_beta", "Ia=i_alpha", "Ib=i_beta", "n=omega", "Theta=theta", "T=load_torque")
    recorded = read_recorded(path, names)
    np.testing.assert_allclose(recorded.t, [0.0, 1e-4])
    np.testing.assert_allclose(recorded.y[0], [3.0, 4.0])
    np.testing.assert_allclose(recorded.truth["omega"], 2 * np.pi)
    np.testing.assert_allclose(recorded.truth["theta"], [np.pi / 2, np.pi])
    np.testing.assert_allclose(recorded.truth["load_torque"], 5.0)
    assert [note.partition(":")[0] for note in recorded.notes] == ["t", "i_alpha", "i_beta", "omega", "theta"]
    scaled = read_recorded(path, names, ["i_alpha=2", "Ib=A", "theta=1"])
    np.testing.assert_allclose(scaled.y[0], [6000.0, 4000.0])
    np.testing.assert_allclose(scaled.truth["theta"], [90.0, 180.0])


@pytest.mark.parametrize(
    ("i_names", "u_names"), [(("i_a", "i_b"), ("u_a", "u_b", "u_c")), (("i_a", "i_b", "i_c"), ("u_ab", "u_bc"))]
)
def test_phase_quantities_become_alpha_beta(i_names: tuple[str, ...], u_names: tuple[str, ...], tmp_path: Path) -> None:
    """The textbook's definition: phases are projections of the space vector; a common voltage cancels."""
    angle = np.linspace(0.0, 6.0, 50)
    phases = angle[:, None] - 2 * np.pi / 3 * np.arange(3)
    i, u = 3 * np.cos(phases), 50 * np.cos(phases + 0.3) + 27.0
    made = {name: i[:, "abc".index(name[2])] for name in i_names}
    for name in u_names:
        first = u[:, "abc".index(name[2])]
        made[name] = first - u[:, "abc".index(name[3])] if len(name) == 4 else first
    np.savez(tmp_path / "d.npz", t=1e-4 * np.arange(50), **made)
    recorded = read_recorded(tmp_path / "d.npz")
    np.testing.assert_allclose(recorded.y, 3 * np.column_stack([np.cos(angle), np.sin(angle)]), atol=1e-12)
    np.testing.assert_allclose(recorded.u, 50 * np.column_stack([np.cos(angle + 0.3), np.sin(angle + 0.3)]), atol=1e-12)
    assert any("Clarke" in note for note in recorded.notes)


@pytest.mark.parametrize("suffix", [".npz", ".csv"])
def test_what_is_written_is_read(suffix: str, tmp_path: Path) -> None:
    columns = dict(zip((*NAMES, "omega"), [*ROWS.T, ROWS[:, 1]], strict=True))
    write_recorded(tmp_path / f"d{suffix}", columns)
    recorded = read_recorded(tmp_path / f"d{suffix}")
    np.testing.assert_array_equal(recorded.u, ROWS[:, 1:3])
    np.testing.assert_array_equal(recorded.truth["omega"], ROWS[:, 1])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "no row of numbers"),
        ("t,u_alpha\n0,1\n", "lacks the column u_beta, i_alpha, i_beta"),
        ("t,u_alpha,u_beta\n", "no row of numbers"),
        ("0,1,2,3,4\n1,1,2,3,4\n", "has no header"),
        ("Time,Valpha,V_beta,I alpha,IBeta\n0,1,2,3,4\n", "--rename Time=t --rename Valpha=u_alpha"),
        ("Time,Valpha,V_beta,I alpha,IBeta\n0,1,2,3,4\n", "--rename 'I alpha'=i_alpha"),
        ("# x\n" + PLAIN + "0,1,2,3,4\n# y\n1e-4,1,2,x,4\n", "line 5, column 'i_alpha' is 'x', not a number"),
        (PLAIN + "0,1,2,3,4\n1e-4,1,2\n", "line 3 has 3 columns, the header has 5: was the file cut off"),
        ("t,u_alpha,u_beta,i_alpha (V),i_beta (V)\n0,1,2,3,4\n", "i_alpha is in A; if it is a probe's"),
        ("t,u_alpha,u_beta,i_alpha (furlong),i_beta\n0,1,2,3,4\n", "neither a unit of current nor a number"),
        ("t,t,u_alpha,u_beta,i_alpha,i_beta\n0,0,1,2,3,4\n", "has the column 't' 2 times"),
    ],
)
def test_what_is_wrong_with_a_file_is_one_line(text: str, expected: str, tmp_path: Path) -> None:
    (tmp_path / "d.csv").write_text(text)
    with pytest.raises(UserError) as caught:
        read_recorded(tmp_path / "d.csv")
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("renames", "scales", "expected"),
    [
        (["t=time"], [], "'time' is no column here"),
        (["zeit=t"], [], "has no 'zeit'; it has t, u_alpha"),
        (["t"], [], "--rename 't' is not of the form theirs=ours"),
        ([], ["i_gamma=2"], "has no 'i_gamma'"),
        ([], ["i_alpha=V"], "that is a unit of voltage, i_alpha is in A"),
        ([], ["i_alpha=many"], "neither a unit of current nor a number"),
        ([], ["i_alpha=0"], "neither a unit of current nor a number"),
    ],
)
def test_wrong_options_are_one_line(renames: list[str], scales: list[str], expected: str, tmp_path: Path) -> None:
    (tmp_path / "d.csv").write_bytes(DIALECTS["plain"])
    with pytest.raises(UserError) as caught:
        read_recorded(tmp_path / "d.csv", renames, scales)
    assert expected in str(caught.value)


def test_damaged_npz_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "d.npz"
    for content in (b"", b"PK\x03\x04 no more", b"words"):
        path.write_bytes(content)
        with pytest.raises(UserError, match="cannot be read as recorded data"):
            read_recorded(path)
    np.savez(path, **dict.fromkeys(NAMES, np.zeros(4)) | {"i_beta": np.zeros(3)})
    with pytest.raises(UserError, match=r"different lengths: .*i_beta 3"):
        read_recorded(path)
    np.savez(path, **dict.fromkeys(NAMES, np.zeros((4, 2))))
    with pytest.raises(UserError, match=r"t has shape \(4, 2\)"):
        read_recorded(path)
    np.savez(path, **dict.fromkeys(NAMES, np.zeros(0)))
    with pytest.raises(UserError, match="holds no samples"):
        read_recorded(path)
    (tmp_path / "image.csv").write_bytes(b"\x89PNG\x00\x00")
    with pytest.raises(UserError, match="is not text"):
        read_recorded(tmp_path / "image.csv")


T = 1e-4


def test_times_that_do_not_fit_are_refused() -> None:
    def refusal(t: np.ndarray) -> str:
        with pytest.raises(UserError) as caught:
            check_clock(t, T, Path("d.csv"), "mine")
        return str(caught.value)

    t = T * np.arange(100)
    assert "every 50 us (median), drive 'mine' steps every 100 us" in refusal(t / 2)
    assert "every 102 us" in refusal(1.02 * t)
    assert "t does not increase from row 4 (0.0003 s) to row 5 (0.0003 s)" in refusal(np.insert(t, 4, t[3]))
    assert "t is not a number in 1 of 100 rows, first in row 8" in refusal(np.where(np.arange(100) == 7, np.nan, t))
    assert "more is missing than recorded" in refusal(np.append(t, 1.0))


def test_jitter_and_gaps_are_told() -> None:
    t = T * np.arange(1000)
    clock = check_clock(t, T, Path("d.csv"), "mine")
    assert clock.notes == []
    assert not clock.gaps
    rng = np.random.default_rng(5)
    clock = check_clock(t + rng.uniform(-0.1, 0.1, 1000) * T, T, Path("d.csv"), "mine")
    assert not clock.gaps
    assert "jitters by" in clock.notes[-1]
    with pytest.raises(UserError, match="not sampled evenly: every "):
        check_clock(t + rng.uniform(-0.3, 0.3, 1000) * T, T, Path("d.csv"), "mine")
    slow = check_clock(1.005 * t, T, Path("d.csv"), "mine")
    assert "median sample time is 100.5 us" in slow.notes[0]
    kept = np.r_[0:300, 310:700, 701:1000]
    clock = check_clock(1.005 * t[kept], T, Path("d.csv"), "mine")
    np.testing.assert_array_equal(clock.steps, kept)
    assert "2 gaps, 11 samples missing, the first after t = 0.0300495 s" in clock.notes[-1]
