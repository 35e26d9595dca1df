"""Alignment before a start: its numbers, its modes proved, and what becomes of rotors that it does not suit."""

from __future__ import annotations

import math
import tomllib
from collections import Counter
from functools import cache
from types import ModuleType
from typing import Any

import mpmath
import numpy as np
import pytest

from codegen.generate import generate
from codegen.output.folder import write_folder
from model.alignment import align_current, align_resistance, align_time, decay_time, swing
from model.drives.load import load_drive, parse_drive
from model.machines.state_space import build
from model.rating import inverter_voltage
from model.schema import Drive, DriveError, Motor, Start
from model.supervisor import supervisor
from runtime.drive.scenario import Scenario
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.faults.loop import FAULT, FaultyLoop, FaultyRun, FoundMotor
from runtime.faults.starts import FROM_REST, TURNING, run_attempt, survey_starts
from runtime.proof.exhaust import link_exhaust
from runtime.proof.link_drive import link_drive
from runtime.proof.link_modes import link_modes
from runtime.proof.link_text import link_text
from runtime.proof.mode_numbers import Numbers
from runtime.proof.modes import Modes
from runtime.proof.second import second_motor
from tests.conftest import thoroughly, variant
from tests.model.accepted import MACHINES, draw_drive

#: Behind dead time with R as a state; salient; flux linkages as states.
ALIGNED = ["servo_24v", "ipmsm", *thoroughly("ipmsm_flux", "spmsm_load_torque", "hub_36v")]


def aligned(name: str, **start: Any) -> Drive:
    drive = variant(load_drive(name), filter={"kinds": ["ckf"]})
    return Drive.model_validate(drive.model_copy(update={"start": Start(method="align", **start)}).model_dump())


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Any:
    made = tmp_path_factory.mktemp("aligned")

    @cache
    def folder(name: str) -> GeneratedFolder:
        write_folder(made / name, generate(aligned(name), samples=200).files)
        return GeneratedFolder(made / name, checked=False)

    return folder


# --- numbers


def test_the_resistance_damps_a_swing_best() -> None:
    """Of the swing's differential equations, whose eigenvalues are found another way; a = psi_I / (L_q I) up to 5."""
    for name in ("ipmsm", "traction_70kw"):
        drive = aligned(name)
        m, current = drive.motor, align_current(drive)
        k = 1.5 * m.pole_pairs**2 * (m.magnet_flux - (m.inductance_q - m.inductance_d) * current) / m.inertia

        def slowest(R: float, m: Any = m, k: float = k, current: float = current) -> float:
            flux = m.magnet_flux + m.inductance_d * current
            moves = [[0, 1, 0], [0, 0, k], [-R * current / m.inductance_q, -flux / m.inductance_q, -R / m.inductance_q]]
            return float(-np.max(np.linalg.eigvals(np.array(moves)).real))

        chosen = m.stator_resistance + align_resistance(drive)
        assert slowest(chosen) == pytest.approx(1 / decay_time(drive))
        assert all(slowest(share * chosen) < slowest(chosen) for share in (0.8, 0.95, 1.05, 1.25))
        ratio = (m.magnet_flux + m.inductance_d * current) / (m.inductance_q * current)
        assert decay_time(drive) * swing(drive) * (ratio - 1) / 4 == pytest.approx(1.0)


@pytest.mark.parametrize("machine", MACHINES)
def test_the_numbers_are_those_by_hand_on_all_motors_that_are_accepted(machine: str) -> None:
    """Every limit of the current and of the resistance counts for some, which it does for no shipped drive."""
    rng, met = np.random.default_rng(len(machine)), Counter[tuple[str, str | bool]]()
    for _ in range(300):
        drawn = draw_drive(rng, machine, "constant_speed", "exact", [])
        drive = Drive.model_validate(drawn.model_dump() | {"start": {"method": "align"}})
        m, hand, T = drive.motor, Numbers(drive.model_dump(), flux=False), drive.model.sample_time
        found = align_current(drive), align_resistance(drive), swing(drive) ** 2
        assert found == pytest.approx((hand.align_current, hand.across, hand.pull), rel=1e-12)
        decay, turn, longest = times_by_hand(m, hand)
        if longest < 32000 * T:  # what is longer is refused
            assert align_time(drive) == pytest.approx(longest, rel=1e-6)
            met["rises", turn > decay] += 1
        else:
            assert align_time(drive) > 31999 * T
        least, other = sorted((m.inductance_d, m.inductance_q))
        voltage = 0.5 * inverter_voltage(drive) / m.stator_resistance
        of = {"share": 0.8 * hand.most, "R": voltage, "reluctance": m.magnet_flux / 2 / max(other - least, 1e-30)}
        met["current", min(of, key=lambda name: of[name])] += 1
        stiff = hand.across >= 0.999 * 0.5 * drive.control.current_bandwidth * least
        met["across", "R" if hand.across == 0 else f"stiff, {other > least}" if stiff else "best"] += 1
    seen = {("rises", True), ("rises", False), ("current", "share"), ("current", "R")}
    seen |= {("across", "R"), ("across", "best"), ("across", f"stiff, {machine != 'surface'}")}
    assert all(met[case] >= 5 for case in seen), met
    assert machine == "surface" or met["current", "reluctance"] >= 5


def times_by_hand(m: Motor, hand: Numbers) -> tuple[float, float, float]:
    """In which a swing decays, the current is turned and all is over, s; roots that are 1e16 apart in 60 digits."""
    flux, k = m.magnet_flux + m.inductance_d * hand.align_current, hand.pull / hand.align_current
    R = m.stator_resistance + hand.across
    with mpmath.workdps(60):
        of = [mpmath.mpf(value) for value in (m.inductance_q, R, k * flux, hand.pull * R)]
        decay = float(-1 / max(mpmath.re(root) for root in mpmath.polyroots(of, maxsteps=500, extraprec=400)))
    turn = max(20e-3, decay)
    return decay, turn, 2 * turn + 7 * decay + math.pi / math.sqrt(hand.pull)


def test_reluctance_takes_no_more_than_half_of_the_magnets_hold() -> None:
    drive = aligned("traction_70kw")
    m, current = drive.motor, np.linspace(0.0, drive.control.max_current, 100_001)
    hold = current * (m.magnet_flux - (m.inductance_q - m.inductance_d) * current)
    assert align_current(drive) == pytest.approx(current[np.argmax(hold)], rel=1e-3)
    assert align_current(aligned("servo_24v")) == pytest.approx(0.8 * load_drive("servo_24v").control.max_current)
    assert align_current(aligned("servo_24v", align_current=3.0)) == 3.0


@pytest.mark.parametrize(
    ("start", "said"),
    [
        ('method = "align"\nfilters = 2', "an aligned rotor has one filter"),
        ("align_current = 2.0", "is for an alignment"),
        ('method = "align"\nalign_current = 11.0', "is beyond 10 A"),
        ('method = "turn"', "align"),
    ],
)
def test_what_a_file_may_not_say(start: str, said: str) -> None:
    text = (GENERATED.parent / "model" / "drives" / "ipmsm.toml").read_text()
    with pytest.raises(DriveError, match=said):
        parse_drive(tomllib.loads(f"{text}\n[start]\n{start}\n"), "ipmsm.toml")


def test_an_alignment_that_no_int_can_count_is_refused() -> None:
    met = Counter[float]()
    for current in np.geomspace(0.01, 2.0, 40):
        drive = aligned("ipmsm", align_current=float(current))
        samples = align_time(drive) / drive.model.sample_time
        met[min(samples // 16000, 4)] += 1
        if samples > 32000:
            with pytest.raises(DriveError, match="an int of 16 bits counts to 32000"):
                supervisor(drive, build(drive))
        else:
            limits = {limit.name: limit.value for limit in supervisor(drive, build(drive)).limits}
            assert limits["ALIGN_SAMPLES"] == round(samples)
    assert {1.0, 2.0, 4.0} <= set(met), "just below, just beyond, and far"


def test_a_rotor_too_heavy_to_turn_is_refused() -> None:
    """Its swing dies down in 1e18 s beside a winding's 1e-10: in a cubic with such roots the slow one may be lost."""
    motor = {"stator_resistance": 1e3, "inductance_d": 1e-7, "inductance_q": 1e-7, "magnet_flux": 1e-4, "inertia": 1e8}
    drive = variant(aligned("ipmsm"), motor=motor)
    assert decay_time(drive) == pytest.approx(1.4815e18, rel=1e-4)
    with pytest.raises(DriveError, match="an int of 16 bits counts to 32000"):
        supervisor(drive, build(drive))


def test_who_does_not_align_has_nothing_of_it() -> None:
    for file in (GENERATED / "servo_24v").rglob("*"):
        if file.suffix in {".c", ".h", ".py", ".md", ".json"}:
            assert "ALIGNING" not in file.read_text().upper().replace("REALIGNING", ""), file


# --- proof


@pytest.mark.parametrize("name", ALIGNED)
def test_the_links_hold(name: str, folders: Any) -> None:
    drive, folder = aligned(name), folders(name)
    data, T = drive.model_dump(), drive.model.sample_time
    flux = build(drive).states[0].unit == "Wb"
    links = [
        link_exhaust(supervisor(drive, build(drive)), name, T, Modes(data, flux).longest),
        link_modes(folder, "ckf", "cubature", data, second_motor(drive)),
        *link_drive(folder, "ckf", "cubature", data),
        link_text(folder, "ckf", "cubature", ("supervisor", "drive")),
    ]
    for link in links:
        assert link.passed, (link.claim, [str(row) for row in link.rows if not row.passed])
    counts = {row.stage: row.compared for row in links[1].rows if row.meaning == "times too seldom"}
    assert {"ALIGNING: aligned", "ALIGNING: lost, CURRENT", "ALIGNING: lost, NOT_ALIGNED"} <= set(counts)


# --- the drive


def run(folder: GeneratedFolder, angle: float, load: float = 0.0, speed: float = 0.0) -> FaultyRun:
    """To the rated speed, from a rotor at an angle (rad) with a load (N m) against it."""
    drive = aligned(folder.drive)
    scenario = Scenario("start", 500.0, 0.05, load, load_at=0.0, duration=align_time(drive) + 0.3)
    loop = FaultyLoop(folder, "ckf")
    return loop.run(scenario, np.empty(0, FAULT), 0.0, motor=FoundMotor(angle, speed))


@pytest.mark.slow
@pytest.mark.parametrize("name", ALIGNED)
@pytest.mark.parametrize("angle", [math.pi, -math.pi / 2, math.pi / 2, 0.0])
def test_a_rotor_that_stands_opposite_is_turned_too(name: str, angle: float, folders: Any) -> None:
    """To the axis, or to where the current points before it; by hand-over it stands along the axis."""
    found, m = run(folders(name), angle), folders(name).module
    assert set(found.mode) == {m.RESTING, m.PROBING, m.ALIGNING, m.RUNNING}
    first = int(np.flatnonzero(found.running)[0])
    assert abs(math.remainder(found.theta[first], 2 * math.pi)) < math.radians(6)
    late = found.t > found.t[-1] - 0.05
    assert np.all(np.abs(found.angle_error[late]) < 10)
    assert np.max(found.current) < 1.5 * load_drive(name).control.max_current


@pytest.mark.slow
def test_a_load_turns_the_rotor_from_the_axis_as_far_as_its_torque_says(folders: Any) -> None:
    drive, load = aligned("ipmsm"), 5.0
    m, current, away = drive.motor, align_current(drive), np.linspace(0.0, 1.2, 10_001)
    flux = m.magnet_flux - (m.inductance_q - m.inductance_d) * current * np.cos(away)
    holds = 1.5 * m.pole_pairs * flux * current * np.sin(away)
    found = run(folders("ipmsm"), 1.0, load)
    first = int(np.flatnonzero(found.running)[0])
    assert found.mode[first - 1] == folders("ipmsm").module.ALIGNING
    turned = math.remainder(found.theta[first], 2 * math.pi)
    assert turned == pytest.approx(-np.interp(load, holds, away), abs=0.03)
    late = found.t > found.t[-1] - 0.05
    assert np.all(np.abs(found.angle_error[late]) < 10), "the filter has found the rest"


@pytest.mark.slow
def test_a_rotor_that_turns_is_caught_and_not_braked(folders: Any) -> None:
    found = run(folders("servo_24v"), 1.0, speed=100.0)
    m = folders("servo_24v").module
    assert m.CATCHING in found.mode
    assert m.ALIGNING not in found.mode


@pytest.mark.slow
@pytest.mark.parametrize(("name", "runs"), [("servo_24v", 6), *thoroughly(("ipmsm", 40), ("hub_36v", 40))])
def test_starts_from_any_angle(name: str, runs: int, folders: Any) -> None:
    for found in survey_starts([folders(name)], None, [FROM_REST, TURNING], runs):
        assert found.locked, [k for k, one in enumerate(found.runs, start=1) if not one.locked]
    attempt, _ = run_attempt(FaultyLoop(folders(name), "ckf"), FROM_REST, 1)
    assert attempt.scenario.duration == pytest.approx(0.3 + align_time(aligned(name)))


def one_interrupt(m: ModuleType, s: Any, f: Any, phase: tuple[float, float]) -> int:
    with np.errstate(all="ignore"):
        return int(m.supervise(s, f, 0, tuple(map(np.float32, phase)), np.float32(10), m.MATH["float32"]))


def test_a_current_that_does_not_come_ends_in_fault_with_its_reason(folders: Any) -> None:
    """Whatever the rotor does: no current, or one across the axis, is not calm."""
    m = folders("servo_24v").module
    s, f, longest = m.new_supervisor(np.float32), m.new_filter(np.float32), 0
    for _ in range(11 * (m.REST_SAMPLES + m.PROBE_SAMPLES + m.ALIGN_SAMPLES + 3)):
        one_interrupt(m, s, f, (0.0, 0.0))
        longest = max(longest, int(s.since)) if s.mode == m.ALIGNING else longest
        assert s.inverter == (s.mode in (m.PROBING, m.ALIGNING))
        assert s.mode != m.RUNNING
        if s.mode == m.FAULT:
            break
    assert (m.MODES[s.mode], m.REASONS[s.reason], int(s.failures)) == ("FAULT", "NOT_ALIGNED", 10)
    assert longest == m.ALIGN_SAMPLES - 1
    assert s.inverter == 0


def test_a_current_that_is_none_ends_it_at_once(folders: Any) -> None:
    m = folders("servo_24v").module
    for bad in (math.nan, math.inf, 1.6 * load_drive("servo_24v").control.max_current):
        s, f = m.new_supervisor(np.float32), m.new_filter(np.float32)
        while s.mode != m.ALIGNING:
            one_interrupt(m, s, f, (0.0, 0.0))
        assert list(s.axis) == [0.0, 0.0, 0.0], "no current before the first step"
        one_interrupt(m, s, f, (bad, 0.0))
        assert (m.MODES[s.mode], m.REASONS[s.reason], int(s.inverter)) == ("RESTING", "CURRENT", 0)
