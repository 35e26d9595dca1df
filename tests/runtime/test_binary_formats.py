"""MATLAB's files and MDF: each reads as the numbers that were written into it by the libraries of the trade."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.recorded.data import read_recorded
from runtime.system.errors import UserError
from tests.runtime.test_formats import ALPHA_BETA, I_A, I_B, TIME, U_AB, U_BC, N, T, channels

pytestmark = pytest.mark.unit

NAMES = {"t": TIME, "u_ab": U_AB, "u_bc": U_BC, "i_a": I_A, "i_b": I_B}


def as_recorded(path: Path, *renames: str) -> None:
    found = read_recorded(path, renames)
    np.testing.assert_allclose(found.t, TIME)
    np.testing.assert_allclose(found.u, ALPHA_BETA["u"], atol=1e-9)
    np.testing.assert_allclose(found.y, ALPHA_BETA["i"], atol=1e-9)


def vectors() -> dict[str, Any]:
    return {name: column[:, None] for name, column in NAMES.items()} | {
        "Ts": T,
        "note": "words",
        "empty": np.zeros((0, 0)),
    }


def structure_with_time() -> dict[str, Any]:
    signals = np.zeros((1, 2), dtype=[("values", object), ("dimensions", object), ("label", object)])
    signals[0, 0] = (np.column_stack([U_AB, U_BC]), 2.0, "u")
    signals[0, 1] = (np.column_stack([I_A, I_B]), 2.0, "")
    return {"ScopeData": {"time": TIME[:, None], "signals": signals, "blockName": "model/Scope"}}


MATLAB: dict[str, tuple[Callable[[], dict[str, Any]], tuple[str, ...]]] = {
    "vectors": (vectors, ()),
    "a matrix": (lambda: {"log": np.column_stack(list(NAMES.values()))}, channels(*(f"log:{k}" for k in range(1, 6)))),
    "fields": (
        lambda: {"out": {"tout": TIME, "u_ab": U_AB, "deep": {"u_bc": U_BC, "ia": I_A}, "ib": I_B}},
        channels("out.tout", "out.u_ab", "out.deep.u_bc", "out.deep.ia", "out.ib"),
    ),
    # Simulink's "Structure with time" of a Scope or To Workspace block.
    "structure with time": (
        structure_with_time,
        channels("ScopeData.time", "u:1", "u:2", "ScopeData.signals2:1", "ScopeData.signals2:2"),
    ),
}


@pytest.mark.parametrize(("what", "form"), [*((what, "5") for what in MATLAB), ("a matrix", "4")])
def test_a_mat_file(what: str, form: str, tmp_path: Path) -> None:
    scipy_io = pytest.importorskip("scipy.io")
    make, renames = MATLAB[what]
    scipy_io.savemat(tmp_path / "d.mat", make(), format=form, do_compression=form == "5")
    as_recorded(tmp_path / "d.mat", *renames)
    if form == "5":  # whose first bytes say so under any name
        (tmp_path / "d.mat").rename(tmp_path / "other.name")
        as_recorded(tmp_path / "other.name", *renames)


@pytest.mark.process  # h5py asks for the processor's name
def test_a_mat_file_of_version_73(tmp_path: Path) -> None:
    """MATLAB writes arrays the other way round, structures as groups, and 512 bytes of its own before the HDF5."""
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "d.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, column in NAMES.items():
            place = f"log/{name}" if name.startswith("i") else name
            file.create_dataset(place, data=column[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
        file.create_dataset("words", data=np.arange(N, dtype="u2")[None, :]).attrs["MATLAB_class"] = np.bytes_("char")
        file.create_dataset("#refs#/a", data=TIME)
        file.create_dataset("matrix", data=np.vstack([TIME, TIME]))
    raw = bytearray(path.read_bytes())
    raw[:19] = b"MATLAB 7.3 MAT-file"
    path.write_bytes(raw)
    as_recorded(path, "log.i_a=i_a", "log.i_b=i_b")
    with pytest.raises(UserError, match=r"it has .*matrix:1, matrix:2"):
        read_recorded(path, ["none=t"])


def test_a_mat_file_without_vectors_says_what_to_do(tmp_path: Path) -> None:
    scipy_io = pytest.importorskip("scipy.io")
    scipy_io.savemat(tmp_path / "d.mat", {"Ts": 1e-4, "note": "words", "cell": np.array([[1, "a"]], dtype=object)})
    with pytest.raises(UserError, match="timeseries or Dataset are MATLAB's alone"):
        read_recorded(tmp_path / "d.mat")


def write_mdf(path: Path, version: str, apart: bool = False) -> None:
    asammdf = pytest.importorskip("asammdf")
    units = {"u_ab": "V", "u_bc": "V", "i_a": "mA", "i_b": "A", "n": "1/min"}
    values = {"u_ab": U_AB, "u_bc": U_BC, "i_a": 1e3 * I_A, "i_b": I_B, "n": 60 + 0 * TIME}
    signals = [asammdf.Signal(values[name], TIME, name=name, unit=unit) for name, unit in units.items()]
    if apart:
        signals[0] = asammdf.Signal(U_AB[::2], TIME[::2], name="u_ab", unit="V")
    with asammdf.MDF(version=version) as file:
        for signal in signals if apart else [signals]:
            file.append(signal if isinstance(signal, list) else [signal])
        file.save(path, overwrite=True)


@pytest.mark.parametrize(("version", "suffix"), [("4.10", ".mf4"), ("3.30", ".mdf"), ("4.11", ".dat")])
def test_an_mdf_file(version: str, suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"d{suffix}"
    write_mdf(path, version)
    written = path if path.exists() else next(tmp_path.iterdir())
    if written != path:
        written.rename(path)
    as_recorded(path, "n=omega")
    assert read_recorded(path, ["n=omega"]).truth["omega"][0] == pytest.approx(2 * np.pi)


def test_mdf_channels_of_two_rasters_are_refused(tmp_path: Path) -> None:
    write_mdf(tmp_path / "d.mf4", "4.10", apart=True)
    with pytest.raises(UserError, match="have rasters of their own"):
        read_recorded(tmp_path / "d.mf4")


DAMAGED = (
    b"",
    b"words",
    b"MATLAB 5.0 MAT-file" + bytes(200),
    b"MDF     4.10    " + bytes(80),
    b"MATLAB 7.3 MAT-file".ljust(512) + b"\x89HDF\r\n\x1a\n" + bytes(40),
    bytes(range(256)) * 9,
)


@pytest.mark.process
@pytest.mark.parametrize("suffix", ["mat", "mf4", "mdf"])
@pytest.mark.parametrize("raw", DAMAGED)
def test_a_damaged_file_is_one_line(suffix: str, raw: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"d.{suffix}"
    path.write_bytes(raw)
    with pytest.raises(UserError) as caught:
        read_recorded(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("suffix", "library", "extra"), [("mat", "scipy.io", "mat"), ("mf4", "asammdf", "mdf")])
def test_a_missing_library_is_named(
    suffix: str, library: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, library, None)
    (tmp_path / f"d.{suffix}").write_bytes(b"anything")
    with pytest.raises(UserError, match=rf"pip install 'pmsm-ickf\[{extra}\]'"):
        read_recorded(tmp_path / f"d.{suffix}")
