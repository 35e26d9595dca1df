"""The soak: its truth is a motor's, its judgements can fail, and the shipped filter holds over a first stretch."""

from __future__ import annotations

import ctypes
import hashlib
import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime.drive.motor import true_motor
from runtime.endurance.journey import make_journey
from runtime.endurance.soak import LOST_EVERY, Decade, Soak, soak
from runtime.estimator.compiler import build_library
from runtime.estimator.folder import GENERATED, find_folder
from tests.target.command import call


@pytest.mark.parametrize("drive", ["paper_spmsm", "ipmsm_flux"])
def test_journey_is_what_the_generated_motor_does(drive: str) -> None:
    """From truth to truth in one interval, under its voltage and load: the generated plant lands there too.

    A voltage that is constant over the interval moves the currents within it a little differently: resistance takes
    another flux linkage, by R di T / 12 at most, and the torque in between is another.
    """
    folder = find_folder(drive)
    j, T = make_journey(folder.manifest["parameters"]), folder.manifest["parameters"]["model"]["sample_time"]
    names = [f"host/{drive}_plant{end}" for end in (".h", ".c")]
    plant = ctypes.CDLL(str(build_library({Path(name).name: folder.text(name) for name in names}, {})))
    motor = np.ascontiguousarray(true_motor(folder, {}))
    m = folder.manifest["parameters"]["motor"]

    def pointer(values: np.ndarray) -> ctypes.c_void_p:
        return ctypes.c_void_p(values.ctypes.data)

    def state(k: int) -> np.ndarray:
        rotor = np.exp(1j * j.theta[k])
        i = j.i[k] / rotor
        z = (m["magnet_flux"] + m["inductance_d"] * i.real + 1j * m["inductance_q"] * i.imag) * rotor
        z = j.i[k] if drive == "paper_spmsm" else z  # the plant's own choice of states, currents or flux linkages
        angle = math.remainder(j.theta[k], math.tau)
        return np.array([z.real, z.imag, j.omega[k], angle, rotor.real, rotor.imag])

    moved = np.abs(np.diff(j.i)).max()
    for k in range(0, len(j.u), len(j.u) // 400):
        s, v = state(k), np.array([j.u[k].real, j.u[k].imag])
        advance, load = getattr(plant, f"{drive}_plant_advance"), ctypes.c_double((j.load[k] + j.load[k + 1]) / 2)
        advance(pointer(s), pointer(motor), pointer(v), load, ctypes.c_double(T / 8), 8)
        i, torque = np.empty(2), np.empty(1)
        getattr(plant, f"{drive}_plant_outputs")(pointer(s), pointer(motor), pointer(i), pointer(torque))
        assert abs(complex(*i) - j.i[k + 1]) < 1e-2 * moved
        assert abs(s[2] - j.omega[k + 1]) < 1e-5 * j.base
        assert abs(math.remainder(s[3] - j.theta[k + 1], math.tau)) < 1e-6


def test_journey_covers_what_it_says_and_closes() -> None:
    j = make_journey(find_folder("paper_spmsm").manifest["parameters"])
    assert j.omega.max() > 1.05 * j.base
    assert j.omega.min() < -1.05 * j.base
    assert np.count_nonzero(np.abs(j.omega) < 1e-6) >= 50  # it stands still
    assert np.count_nonzero(np.diff(np.sign(j.omega[np.abs(j.omega) > 1e-6]))) == 2  # and turns round twice
    assert abs(j.omega[-1] - j.omega[0]) < 1e-9
    assert abs(j.load[-1] - j.load[0]) < 1e-9
    rotor = np.exp(-1j * j.theta)
    assert abs((j.i * rotor)[-1] - (j.i * rotor)[0]) < 1e-6


@pytest.mark.thorough
def test_filter_holds_over_a_first_stretch(tmp_path: Path) -> None:
    done = call("soak", "paper_spmsm", "--steps", "200000", "--json", "s.json", "--plots", "figures", cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    (run,) = json.loads((tmp_path / "s.json").read_text())["runs"]
    assert [decade["until"] for decade in run["decades"]] == [100_000, 200_000]
    assert max(max(decade["deviation"]) for decade in run["decades"]) > 0  # two precisions, not one
    assert (tmp_path / "figures" / "soak.svg").is_file()


def test_currents_that_are_lost_are_counted() -> None:
    (run,) = soak([("spmsm_load_torque", LOST_EVERY + 7)], "ickf")
    assert run.failures() == []
    assert sum(decade.rejected for decade in run.decades) == 50


def test_a_wrong_constant_in_float32_comes_apart(tmp_path: Path) -> None:
    """A constant of the firmware's file is off by a thousandth, which float64 does not share."""
    shutil.copytree(GENERATED / "paper_spmsm", tmp_path / "paper_spmsm")
    path = tmp_path / "paper_spmsm" / "paper_spmsm_ickf.c"
    text = path.read_text().replace("DECAY_I 0.93113774f", "DECAY_I 0.93f")
    path.write_text(text)
    manifest = tmp_path / "paper_spmsm" / "manifest.json"
    facts = json.loads(manifest.read_text())
    facts["files"][path.name]["sha256"] = hashlib.sha256(path.read_bytes()).hexdigest()
    manifest.write_text(json.dumps(facts))
    (run,) = soak([(str(tmp_path / "paper_spmsm"), 50_000)], "ickf")
    assert any("float32 and float64 differ in" in line for line in run.failures())


GOOD = Decade(10**6, (1e-6, 1e-7), (1e-5, 1e-5), (1e-4, 1e-4), 1e-6, 0.1, 1.0, 0, 0, 0, 0, 0, 0)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({}, None),
        ({"deviation": (1.1e-5, 1e-7)}, "differ in omega by 1.1e-05 rad/s, allowed 1e-05"),
        ({"deviation": (float("nan"), 1e-7)}, "differ in omega by nan"),
        ({"share": (1e-4, 0.02)}, "differ in theta by 0.02 sigma"),
        ({"covariance": 0.02}, "differ in P by 0.02"),
        ({"unexpected": 2, "bits": 8, "first_unexpected": 123}, "in 2 steps (bits 0x8), first at step 123"),
        ({"not_finite": 1}, "1 steps after which a number is none"),
        ({"angle": 0.8}, "the lock was lost, theta off by 46 degrees"),
        ({"rejected": 1}, "0 steps had no currents, 1 said so"),
    ],
)
def test_what_fails_is_said(change: dict[str, object], said: str | None) -> None:
    names, units = ("omega", "theta"), ("rad/s", "rad")
    run = Soak("d", "ickf", names, units, 1e-4, (1e-6, 1e-7, 1e-6), [replace(GOOD, until=10**5, **change)])  # type: ignore[arg-type]
    assert (said is None) == (run.failures() == [])
    assert said is None or any(said in line for line in run.failures())


def test_growth_is_said() -> None:
    grown = replace(GOOD, until=10**7, deviation=(3.1e-6, 1e-7), rejected=470)
    run = Soak("d", "ickf", ("omega", "theta"), ("rad/s", "rad"), 1e-4, (1e-6, 1e-7, 1e-6), [GOOD, grown])
    assert run.failures() == ["d/ickf: the deviation of omega grew 3.1 times up to step 1e+07"]


def test_bad_requests_are_one_line(tmp_path: Path) -> None:
    for words, said in ((["nosuch"], "no drive 'nosuch'"), (["ipmsm", "--filter", "ekf"], "no filter 'ekf'")):
        done = call("soak", *words, cwd=tmp_path)
        assert done.returncode == 2
        assert said in done.stderr
        assert len(done.stderr.splitlines()) == 1
