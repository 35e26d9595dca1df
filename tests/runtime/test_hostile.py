"""Files that are wrong in every way: each is refused with one line and exit code 2, none ends in a traceback."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from model.drives.load import DRIVES, load_drive
from model.schema import DriveError
from runtime.board.session import inputs_of
from runtime.estimator.folder import GENERATED, find_folder
from runtime.system.errors import UserError
from tests.runtime.hostile import assert_refused, command

PAPER = (DRIVES / "paper_spmsm.toml").read_text(encoding="utf-8")

#: Seconds of a run vary with the machine; the examples do not.
HOSTILE = settings(derandomize=True, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
FEW = settings(HOSTILE, max_examples=HOSTILE.max_examples // 4)


@pytest.fixture(scope="module")
def place() -> Iterator[Path]:
    """One folder for all examples, which is also where the commands run."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            yield Path(folder)
        finally:
            os.chdir(before)


# --- drive files ---

KEYS = [
    line.partition("=")[0].strip() for line in PAPER.splitlines() if "=" in line and not line.lstrip().startswith("#")
]

LITERALS = st.one_of(
    st.floats().map(lambda x: repr(x) if x == x else "nan"),
    st.integers(-(10**400), 10**400).map(str),
    st.sampled_from(
        ["nan", "-inf", "1e400", "-1e-400", "true", "1979-05-27", "07:32:00", "[]", "[[]]", "{}", "0x7fffffffffffffff"]
    ),
    st.text(max_size=20).map(lambda text: json.dumps(text, ensure_ascii=False).replace("\x7f", "")),
    st.lists(st.sampled_from(["1", "nan", "-1e300", "'x'", "[1]", "{a = 1}"]), max_size=12).map(
        lambda items: f"[{', '.join(items)}]"
    ),
)  # fmt: skip


def changed(key: str, literal: str) -> str:
    """The paper's drive with one key's value replaced."""
    lines = [f"{key} = {literal}" if line.partition("=")[0].strip() == key else line for line in PAPER.splitlines()]
    return "\n".join(lines) + "\n"


def check_drive_file(place: Path, raw: bytes) -> None:
    """Refused alike by all commands, where it is not a good one by chance."""
    path = place / "hostile.toml"
    path.write_bytes(raw)
    try:
        load_drive(path)
    except DriveError:
        lines = {
            assert_refused(*words)
            for words in (
                ("generate", str(path), "--out", str(place / "out")),
                ("verify", str(path)),
                ("simulate", str(path)),
                ("replay", str(path), "data.npz"),
                ("compare", str(path), "paper_spmsm"),
            )
        }
        assert len(lines) == 1
        assert not (place / "out").exists()


@HOSTILE
@given(st.sampled_from(KEYS), LITERALS)
@example("name", '"../../etc"')
@example("pole_pairs", "1" + "0" * 5000)
@example("controller_cycles", "1" + "0" * 400)
@example("stator_resistance", "1" + "0" * 400)
@example("initial_covariance", "[" * 2000 + "]" * 2000)
@example("process_noise", "[" + "1e300," * 5000 + "]")
@example("kinds", "[" + "'pf'," * 5000 + "]")
@example("magnet_flux", '"' + "9" * 100_000 + '"')
def test_a_key_with_a_hostile_value(place: Path, key: str, literal: str) -> None:
    check_drive_file(place, changed(key, literal).encode("utf-8", "surrogatepass"))


@HOSTILE
@given(st.binary(max_size=200) | st.text(max_size=200).map(lambda text: text.encode("utf-8", "surrogatepass")))
@example(b"")
@example(b"\xff\xfe\x00")
@example(b"a = " + b"[" * 100_000)
@example(b"a." * 2_000 + b"b = 1")
@example(b"a = " + b"9" * 10_000)
@example(b"[motor]\n[motor]\n")
@example(b"motor = 1\nmodel = 2\nfilter = 3\n")
@example(b"\xef\xbb\xbf" + PAPER.encode())
def test_a_drive_file_of_anything(place: Path, raw: bytes) -> None:
    check_drive_file(place, raw)


@HOSTILE
@given(st.integers(0, len(PAPER)), st.text(max_size=5), st.integers(0, 60))
def test_a_drive_file_with_something_in_the_middle(place: Path, at: int, text: str, gone: int) -> None:
    check_drive_file(place, (PAPER[:at] + text + PAPER[at + gone :]).encode("utf-8", "surrogatepass"))


@HOSTILE
@given(st.sampled_from(["motor", "model", "filter", "operating_box", "control", "budget", ""]), st.text(max_size=60))
@example("", "sha256")
@example("motor", "ünknown\n\x1b[31m")
def test_unknown_keys_and_sections(place: Path, section: str, key: str) -> None:
    quoted = json.dumps(key, ensure_ascii=True)
    check_drive_file(place, (PAPER + f"\n[{section or quoted}]\n{quoted} = 1\n").encode("utf-8", "surrogatepass"))


@pytest.mark.slow
@FEW
@given(
    st.tuples(st.floats(1e-4, 1e3), st.floats(1e-6, 0.5), st.floats(1e-4, 10.0), st.floats(1e-8, 1e3)),
    st.tuples(st.floats(1e-6, 1e-2), st.floats(1e-3, 1e5), st.floats(1e-1, 1e5), st.floats(1.0, 1e4)),
    st.lists(st.sampled_from([5e-324, 1e-38, 1e-3, 1e12]), min_size=10, max_size=10),
)
@example((1e3, 1e-6, 1e-4, 1e-8), (1e-2, 1e5, 1e5, 1e4), [1e12] * 10)
@example((1e-4, 0.5, 10.0, 1e3), (1e-6, 1e-3, 1e-1, 1.0), [5e-324] * 10)
def test_every_number_at_an_end_of_its_range(
    place: Path, motor: tuple[float, ...], around: tuple[float, ...], variances: list[float]
) -> None:
    """A drive within the ranges is generated or refused in one line: by budget or because float32 cannot hold it."""
    resistance, inductance, flux, inertia = motor
    T, current, voltage, speed = around
    text = "\n".join(
        [
            'name = "extreme"',
            f"[motor]\nstator_resistance = {resistance!r}",
            f"inductance_d = {inductance!r}\ninductance_q = {inductance!r}",
            f"magnet_flux = {flux!r}\npole_pairs = 100\ninertia = {inertia!r}\nfriction = 0.0",
            f'[model]\nmachine = "surface"\ndiscretization = "exact"\nsample_time = {T!r}',
            f'[filter]\nkinds = ["ckf"]\ninitial_covariance = {variances[:4]!r}\nprocess_noise = {variances[4:8]!r}',
            f"measurement_noise = {variances[8:]!r}",
            f"[operating_box]\ncurrent = {current!r}\nvoltage = {voltage!r}\nspeed = {speed!r}",
        ]
    )
    path = place / "extreme.toml"
    path.write_text(text + "\n", encoding="utf-8")
    code, said = command("generate", str(path), "--out", str(place / "extreme"), "--force")
    lines = [line for line in said.splitlines() if "caution" not in line]
    assert code in {0, 1, 2}
    assert len(lines) == (1 if code else 0), said


# --- generated folders with a manifest of anything ---


@HOSTILE
@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.text(max_size=8),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(st.sampled_from(["drive", "filters", "files", "parameters", "x.py"]), inner, max_size=4)
        ),
        max_leaves=12,
    )
)
@example({"drive": "../x", "filters": {"ckf": {}}, "files": {}, "parameters": {}})
@example({"drive": "x", "filters": {}, "files": {}, "parameters": {}})
def test_a_manifest_of_anything(place: Path, manifest: Any) -> None:
    (place / "folder").mkdir(exist_ok=True)
    (place / "folder" / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    assert_refused("replay", "folder", "data.npz")
    assert_refused("compare", "folder", "paper_spmsm")
    assert_refused("pil", "folder", "--port", "simulated")


@pytest.mark.parametrize("text", ["", "{", "\x00", "[" * 100_000, '"' + "x" * 1000])
def test_a_manifest_that_is_no_json(place: Path, text: str) -> None:
    (place / "folder").mkdir(exist_ok=True)
    (place / "folder" / "manifest.json").write_text(text, encoding="utf-8")
    assert_refused("replay", "folder", "data.npz")
    assert_refused("compare", "folder", "paper_spmsm")


@pytest.mark.parametrize("section", ["motor", "model", "filter"])
def test_a_manifest_with_other_parameters(place: Path, section: str) -> None:
    """The files are whole, the manifest's parameters are not a drive's."""
    shutil.copytree(GENERATED / "paper_spmsm", place / section)
    path = place / section / "manifest.json"
    manifest = json.loads(path.read_text(encoding="utf-8"))
    manifest["parameters"][section] = 1
    path.write_text(json.dumps(manifest), encoding="utf-8")
    assert_refused("compare", section, "spmsm_load_torque")
    assert_refused("pil", section, "--port", "simulated")


# --- recorded data ---

NAMES = ("t", "u_alpha", "u_beta", "i_alpha", "i_beta", "omega", "theta", "load_torque")
DTYPES = ("f8", "f4", "f2", "i8", "u1", "?", "c16", "S3", "U3", "M8[s]", "O", "V4", [("a", "f8"), ("b", "i4")])


class Trap:
    """A file that would be made if a pickled column were ever unpacked."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, ("sprung",)


@st.composite
def columns(draw: st.DrawFn) -> dict[str, np.ndarray]:
    """Columns that are good but for some: of another type, shape or length, full of NaN, missing."""
    n = draw(st.integers(0, 6))
    made = {name: np.arange(n) * (2e-5 if name == "t" else 1.0) for name in NAMES}
    for name in draw(st.lists(st.sampled_from(NAMES), max_size=3)):
        what = draw(st.sampled_from(["type", "shape", "value", "gone"]))
        if what == "gone":
            made.pop(name, None)
        elif what == "value" and name in made:
            made[name] = np.full(n, draw(st.sampled_from([np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324])))
        else:
            kind = np.dtype(draw(st.sampled_from(DTYPES)))
            shape = draw(st.sampled_from([(), (n,), (n + 1,), (n, 1), (1, n), (0,), (n, 2, 2)]))
            made[name] = np.full(shape, Trap(), dtype=object) if kind.hasobject else np.zeros(shape, dtype=kind)
    return made


def check_data(path: Path) -> None:
    """Refused in one line, or taken; the same by both readers."""
    code, said = command("replay", "paper_spmsm", str(path), "--backend", "numpy")
    assert not Path("sprung").exists(), "a pickled column was unpacked"
    if code == 2:
        (line,) = said.splitlines()
        assert line.startswith("pmsm-ickf: ")
        assert line.isprintable()
        assert len(line) < 600
    else:
        assert (code, said) in {(0, ""), (1, "")}
    try:
        inputs_of(find_folder("paper_spmsm"), path, 10)  # as pil --data reads it
    except UserError:
        assert code == 2


@HOSTILE
@given(columns())
@example({name: np.zeros(3) for name in NAMES})
@example({name: np.arange(3) * 2e-5 for name in NAMES} | {"theta": np.array([Trap()] * 3)})
@example({name: np.arange(3) * 2e-5 for name in NAMES} | {"omega": np.full(3, 1e308)})
def test_npz_of_any_columns(place: Path, columns: dict[str, np.ndarray]) -> None:
    np.savez(place / "data.npz", allow_pickle=True, **columns)
    check_data(place / "data.npz")


@HOSTILE
@given(st.data())
def test_npz_cut_off_or_overwritten(place: Path, data: st.DataObject) -> None:
    path = place / "data.npz"
    np.savez_compressed(path, **{name: np.arange(20) * 2e-5 for name in NAMES})
    raw = bytearray(path.read_bytes())
    if data.draw(st.booleans()):
        raw = raw[: data.draw(st.integers(0, len(raw)))]
    else:
        for at in data.draw(st.lists(st.integers(0, len(raw) - 1), min_size=1, max_size=4)):
            raw[at] = data.draw(st.integers(0, 255))
    path.write_bytes(raw)
    check_data(path)


@pytest.mark.parametrize(
    "shape", ["(1000000000000,)", "(-1,)", "(3, 10**9)", "(" * 500 + ")" * 500, "(4611686018427387904, 4)", "'x'"]
)
def test_npz_whose_header_lies(place: Path, shape: str) -> None:
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".encode()
    raw = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(24)
    with zipfile.ZipFile(place / "data.npz", "w") as archive:
        for name in NAMES:
            archive.writestr(f"{name}.npy", raw)
    assert_refused("replay", "paper_spmsm", str(place / "data.npz"))


@HOSTILE
@given(st.binary(max_size=300), st.sampled_from(["npz", "csv", "txt", "json", "mat", "mf4", ""]))
@example(b"", "npz")
@example(b"PK\x05\x06" + bytes(18), "npz")
@example(b"\x93NUMPY", "npz")
@example(b"", "csv")
@example(b"\xff\xfe", "csv")
@example(b'{"passed": true, "drives": []}', "json")
@example(b"t,u_alpha,u_beta,i_alpha,i_beta\n" + b"1,2,3,4,5," * 1000, "csv")
@example(b"MATLAB 5.0 MAT-file" + bytes(300), "")
@example(b"MATLAB 7.3 MAT-file".ljust(512) + b"\x89HDF\r\n\x1a\n" + bytes(99), "mat")
@example(b"MDF     4.10    " + bytes(300), "mf4")
@example(b"X,CH1,CH2,Start,Increment\nSequence,Volt,Volt,nan,1e999\n0,1,2\n1,1,2\n", "csv")
@example(b"CH1V,t0 = -, tInc = 1e,\n1,2\n3,4\n", "csv")
@example(b"1e308,1,2,3,4\n-1e308,1,2,3,4\n", "csv")
def test_data_of_any_bytes(place: Path, raw: bytes, suffix: str) -> None:
    path = place / f"data.{suffix}"
    path.write_bytes(raw)
    check_data(path)


CELLS = st.sampled_from(
    [
        "1",
        "-2.5e-3",
        "nan",
        "inf",
        "",
        "x",
        '"',
        "1e999",
        "1_000",
        "0x10",
        "٣",
        "1,5",
        "#",
        "//",
        "%",
        "∞",
        "V",
        "s",
        "--",
    ]
)


@HOSTILE
@given(
    st.lists(
        st.sampled_from([*NAMES, "time (ms)", "i_a", "i_b", "duty_a", "v_dc", "Start", "t0=1", "", "é"]), max_size=8
    ),
    st.lists(st.lists(CELLS, max_size=8), max_size=6),
    st.sampled_from([",", ";", "\t", " ", ",,"]),
    st.sampled_from(["\n", "\r\n", "\r", "\n\n"]),
)
@example(["t", "u_alpha", "u_beta", "i_alpha", "i_beta"], [["٣"] * 5, ["1"] * 5], ",", "\n")
def test_csv_of_garbage(place: Path, names: list[str], rows: list[list[str]], separator: str, end: str) -> None:
    text = end.join(separator.join(row) for row in [names, *rows])
    (place / "data.csv").write_bytes(text.encode())
    check_data(place / "data.csv")


def test_data_that_is_no_file(place: Path) -> None:
    (place / "a_folder.npz").mkdir()
    (place / "a_folder.csv").mkdir()
    for name in ("a_folder.npz", "a_folder.csv", "none.npz", "none\n\x1b[31m.csv", "x" * 300 + ".csv"):
        assert_refused("replay", "paper_spmsm", name)


def test_data_that_is_a_pipe(place: Path) -> None:
    """It would be waited for, or empty when its numbers are read after its header."""
    os.mkfifo(place / "pipe.csv")
    assert "'pipe.csv' is a pipe" in assert_refused("replay", "paper_spmsm", "pipe.csv")
    os.symlink("loop.csv", place / "loop.csv")
    assert "Too many levels of symbolic links" in assert_refused("replay", "paper_spmsm", "loop.csv")


def test_a_line_longer_than_where_its_header_is_looked_for(place: Path) -> None:
    names = ",".join(["t,u_alpha,u_beta,i_alpha,i_beta", *(f"c{k}" for k in range(60_000))])
    (place / "wide.csv").write_text("\n".join([names, ",".join(["1"] * 60_005), ",".join(["2"] * 60_005)]) + "\n")
    assert "no row of numbers in its first 262,144 bytes" in assert_refused("replay", "paper_spmsm", "wide.csv")


def test_nobody_is_told_to_unpickle(place: Path) -> None:
    (place / "text.npz").write_text("t,u_alpha,u_beta,i_alpha,i_beta\n0,1,2,3,4\n")
    np.save(place / "one.npy", np.zeros(3))
    (place / "one.npy").rename(place / "one.npz")
    for name in ("text.npz", "one.npz"):
        assert "is no archive of arrays" in assert_refused("replay", "paper_spmsm", name)


@pytest.mark.parametrize("raw", [b"", b"PK\x03\x04", b"t,u_alpha\n1,2\n", b"\x00"])
@pytest.mark.parametrize("suffix", ["npz", "csv"])
def test_pil_with_bad_data(place: Path, raw: bytes, suffix: str) -> None:
    path = place / f"pil.{suffix}"
    path.write_bytes(raw)
    assert_refused("pil", "--port", "simulated", "--data", str(path))
