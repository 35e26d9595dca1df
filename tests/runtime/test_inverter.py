"""The inverter through the chain of proof, for every kind of filter; and the simulator's, a code of its own."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from codegen.generate import generate_bare
from codegen.output.folder import write_folder
from model.drives.load import load_drive
from model.inverter import lost_voltage
from model.machines.lost_voltage import LostVoltage
from model.schema import Drive, Inverter, Tolerance
from runtime.drive.fleet import Cases, Fleet
from runtime.drive.motor import inverter_of
from runtime.drive.scenario import Scenario
from runtime.drive.simulation import Conditions, Simulator
from runtime.estimator.folder import GeneratedFolder
from runtime.proof.derivation import compare_derivations
from runtime.proof.link_foc import link_control
from runtime.proof.link_guard import link_data
from runtime.proof.link_text import link_text
from runtime.proof.own_trajectory import trajectory_of
from runtime.proof.second import CasadiMotor, second_motor
from runtime.proof.verify import Prover, literal_package
from tests.conftest import thoroughly, variant
from tests.runtime.test_proof import QUICK, _prover

KINDS = ("ckf", "ickf", "ekf", "ukf")


def lossy(name: str, state: bool, discretization: str = "exact", kinds: tuple[str, ...] = KINDS) -> Drive:
    """A shipped drive behind an inverter with dead time and drop."""
    drive = load_drive(name)
    drive = drive.model_copy(update={"inverter": Inverter(dead_time=2e-6, switch_drop=0.5)})
    f, model = drive.filter, {"discretization": discretization}
    tuning: dict[str, Any] = {"kinds": list(kinds)}
    if state:
        model["adaptive"] = [*drive.model.adaptive, "dead_time_voltage"]  # type: ignore[assignment]
        tuning |= {"initial_covariance": [*f.initial_covariance, 1.0], "process_noise": [*f.process_noise, 1e-6]}
        tuning |= {"root_order": [*f.root_order, "dead_time_voltage"]} if f.root_order else {}
    return variant(drive, model=model, filter=tuning)


def prover(drive: Drive, folder: Path) -> Prover:
    package = generate_bare(drive)
    write_folder(folder, package.files)
    short = trajectory_of(drive, 60)
    made = GeneratedFolder(folder, checked=False)
    return Prover(package, literal_package(drive), made, short, (short, 10), QUICK, lambda text: None)


#: A surface machine with a CKF behind a known inverter is proved whole in every run: the fan of test_design_trial.py.
CHAINS = [
    ("ipmsm_flux", True, "exact", "ickf"),
    *thoroughly(("spmsm_load_torque", False, "exact", "ckf")),
    *thoroughly(*[("spmsm_load_torque", True, "exact", kind) for kind in KINDS]),
    *thoroughly(*[("ipmsm_flux", False, "exact", kind) for kind in KINDS]),
    *thoroughly(*[("ipmsm", state, "euler", "ckf") for state in (False, True)]),
    *thoroughly(("spmsm_adaptive", True, "exact", "ickf")),
]


@pytest.mark.parametrize(("name", "state", "discretization", "kind"), CHAINS)
def test_the_chain_holds(name: str, state: bool, discretization: str, kind: str, tmp_path: Path) -> None:
    drive = lossy(name, state, discretization, (kind,))
    found = prover(drive, tmp_path / name)
    links = [*found.along_trajectory(kind), *found._box(kind), *found._guards(kind)]
    links += [link_text(found.folder, kind, drive.filter.gain), found._bits(kind).link(("-O2",))]
    links += [found._bits(kind).lane_link()]
    links += link_control(found.folder, kind, drive.filter.gain, drive.model_dump(), second_motor(drive))
    for link in links:
        assert link.passed, (link.claim, str(link.divergence), [str(row) for row in link.rows if not row.passed])
    seen = {row.stage for link in links if link.name == "A-B" for row in link.rows}
    assert {"v", "g"} & seen == ({"v", "g"} if state else {"v"})


@pytest.mark.parametrize("state", [False, True], ids=["known", "learnt"])
def test_controller_and_data_by_hand(state: bool, tmp_path: Path) -> None:
    """What the duty cycles carry and the filter is told of, and what _init loads."""
    drive = lossy("spmsm_load_torque", state, kinds=("ckf",))
    write_folder(tmp_path / drive.name, generate_bare(drive).files)
    folder, motor = GeneratedFolder(tmp_path / drive.name, checked=False), second_motor(drive)
    links = link_control(folder, "ckf", "cubature", drive.model_dump(), motor)
    links += [link_data(folder, "ckf", "cubature", drive.model_dump(), motor)]
    for link in links:
        assert link.passed, (link.claim, [str(row) for row in link.rows if not row.passed])


@pytest.mark.unit
@pytest.mark.parametrize("name", ["spmsm_load_torque", "ipmsm_flux"])
@pytest.mark.parametrize("state", [False, True])
def test_sympy_states_the_same(name: str, state: bool) -> None:
    link = compare_derivations(lossy(name, state))
    assert link.passed
    assert [row.stage for row in link.rows][4:] == (["v", "g"] if state else ["v"])


FAULTS: dict[str, Any] = {
    "signs": lambda original: lambda self, i: (lambda pair, named: ((pair[1], pair[0]), named))(*original(self, i)),
    "remaining": lambda original: staticmethod(lambda u, g, V_d: (u[0] + V_d * g[0], u[1] - V_d * g[1])),
    "unsure": lambda original: staticmethod(lambda signs: 0.9 * original(signs)),
    "seen": lambda original: lambda self, i: 1.0 + 0.0 * original(self, i),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_wrong_term_is_noticed_by_either_statement(
    fault: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    drive = lossy("spmsm_load_torque", fault != "unsure", kinds=("ckf",))
    if fault == "unsure":
        drive = drive.model_copy(update={"tolerance": Tolerance(dead_time=0.2)})
    monkeypatch.setattr(LostVoltage, fault, FAULTS[fault](getattr(LostVoltage, fault)))
    assert not compare_derivations(drive).passed
    package = generate_bare(drive, "literal")
    write_folder(tmp_path / "wrong", package.files)
    found = _prover(drive, package, tmp_path / "wrong")
    assert not all(link.passed for link in [*found.along_trajectory("ckf"), *found._box("ckf")])


@pytest.mark.unit
@pytest.mark.parametrize("state", [False, True])
def test_the_model_itself_as_a_reference_takes_the_voltage_that_arrives(state: bool) -> None:
    """What stands in for a machine file without a second statement, against the motors by hand."""
    drive = lossy("ipmsm_flux", state)
    from model.machines.state_space import build

    own, hand = CasadiMotor(build(drive)), second_motor(drive)
    x = np.array([0.2, -0.1, 90.0, 0.4, *([1.0] * (len(build(drive).states) - 4))])
    v = np.array([20.0, -7.0])
    np.testing.assert_allclose(own.f(x, v), hand.f(x, v), rtol=1e-12)
    by_v = np.array([(hand.f(x, v + d) - hand.f(x, v - d)) / 2 for d in np.eye(2)]).T
    np.testing.assert_allclose(own.B(x, v), by_v, atol=1e-9)


# --- the simulator's inverter


@lru_cache
def simulator(tmp: str) -> Simulator:
    drive = lossy("spmsm_load_torque", False, kinds=("ckf",))
    write_folder(Path(tmp), generate_bare(drive).files)
    return Simulator(GeneratedFolder(Path(tmp)), "ckf")


@pytest.fixture(scope="module")
def loop(tmp_path_factory: pytest.TempPathFactory) -> Simulator:
    return simulator(str(tmp_path_factory.mktemp("lossy") / "spmsm_load_torque"))


def settled(loop: Simulator, duty: list[float], **conditions: Any) -> float:
    """Current on the d axis, A, mean of a period, 50 ms after a voltage is put on a rotor that stands at angle 0."""
    m = loop._machine(Conditions(noise=0.0, **conditions))
    phase, found = loop._ffi.new("float[2]"), []
    for _ in range(500):
        loop._library.simulator_actuate(m, duty, 0.0)
        loop._library.simulator_sense(m, [0.0, 0.0], phase)
        found.append(phase[0])
    return float(np.mean(found[-20:]))


@pytest.mark.parametrize("inverter", ["averaged", "pwm"])
@pytest.mark.parametrize(("dead_time", "drop"), [(0.0, 0.0), (2e-6, 0.0), (0.0, 1.5), (2e-6, 1.5)])
def test_the_simulated_inverter_loses_what_theory_says(
    loop: Simulator, inverter: str, dead_time: float, drop: float
) -> None:
    """Phase a against b and c: 4/3 of what a leg loses, over the resistance."""
    lost = 311.0 * dead_time / 100e-6 + drop
    current = settled(loop, [0.6, 0.5, 0.5], inverter=inverter, dead_time=dead_time, switch_drop=drop)
    assert current == pytest.approx((311.0 * 2 / 3 * 0.1 - 4 / 3 * lost) / 2.875, rel=0.01)


def test_the_drive_file_says_what_is_lost_unless_told_otherwise(loop: Simulator) -> None:
    drive = lossy("spmsm_load_torque", False)
    stated = settled(loop, [0.6, 0.5, 0.5])
    assert stated == pytest.approx((311.0 * 2 / 3 * 0.1 - 4 / 3 * lost_voltage(drive)) / 2.875, rel=0.01)
    assert settled(loop, [0.6, 0.5, 0.5], dead_time=0.0, switch_drop=0.0) > stated + 2.0
    assert inverter_of(load_drive("ipmsm").stated) == (0.0, 0.0)
    faster = drive.model_copy(update={"inverter": Inverter(dead_time=1e-6, switching_frequency=20e3)})
    assert inverter_of(faster.stated) == (pytest.approx(2e-6), 0.0), "two periods of the carrier in a sample"


def test_a_pulse_too_short_is_left_out_and_a_gap_too_short_is_filled(loop: Simulator) -> None:
    ideal = {"inverter": "pwm", "dead_time": 0.0, "switch_drop": 0.0}
    assert settled(loop, [0.02, 0.0, 0.0], **ideal) > 1.0
    assert settled(loop, [0.02, 0.0, 0.0], min_pulse=3e-6, **ideal) == 0.0
    assert settled(loop, [1.0, 0.98, 0.98], min_pulse=3e-6, **ideal) == 0.0
    assert settled(loop, [0.04, 0.0, 0.0], min_pulse=3e-6, **ideal) == settled(loop, [0.04, 0.0, 0.0], **ideal)


def test_a_fleet_loses_what_the_simulator_does(loop: Simulator) -> None:
    scenario = Scenario("short", speed=300.0, ramp=0.03, load=2.0, load_at=0.05, duration=0.08)
    fleet = Fleet(loop.folder, "ckf")
    cases = Cases(seed=np.arange(3, dtype=np.uint64))
    outcomes, run = fleet.run(scenario, cases), fleet.trace(scenario, cases, 1)
    assert run.figures()["start"] == pytest.approx(float(outcomes.columns()["start"][1]), rel=1e-9)
    ideal = loop.run(scenario, Conditions(dead_time=0.0, switch_drop=0.0))
    assert abs(ideal.figures()["start"] - run.figures()["start"]) > 1e-3


def test_the_filter_that_knows_the_inverter_holds_what_the_other_loses(loop: Simulator, tmp_path: Path) -> None:
    """Carrier comparison, 2 us of dead time that no controller makes up for, 100 r/min: the plain drive is lost."""
    scenario = Scenario("slow", speed=100.0, load=5.0)
    hard = Conditions(inverter="pwm", dead_time=2e-6, bits=12, delay=1, compensate=False)
    knows = loop.run(scenario, hard)
    assert knows.locked
    assert knows.figures()["steady_rms"] < 3.0
    write_folder(tmp_path / "plain", generate_bare(load_drive("spmsm_load_torque")).files)
    plain = Simulator(GeneratedFolder(tmp_path / "plain"), "ckf").run(scenario, hard)
    assert not plain.locked


def test_the_controller_makes_up_for_the_estimate(tmp_path: Path) -> None:
    """V_d learnt from nothing: it is what the simulator takes, and the gain switches the compensation off."""
    drive = lossy("spmsm_load_torque", True, kinds=("ckf",)).model_copy(update={"inverter": None})
    drive = variant(drive, filter={"initial_covariance": [*drive.filter.initial_covariance[:-1], 25.0]})
    write_folder(tmp_path / "learns", generate_bare(drive).files)
    learns = Simulator(GeneratedFolder(tmp_path / "learns"), "ckf")
    hard = {"inverter": "pwm", "dead_time": 2e-6, "delay": 1}
    for compensate in (True, False):
        run = learns.run(Scenario("load_step", speed=1000.0, load=5.0), Conditions(**hard, compensate=compensate))
        assert run.locked
        assert run.x[-1, -1] == pytest.approx(311.0 * 2e-6 / 100e-6, rel=0.1)
