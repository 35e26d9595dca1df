"""Facts to a drive file: conversions by another way, rules on facts drawn over all that is accepted, the file."""

from __future__ import annotations

import copy
import math
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from codegen.generate import Package
from model.drives.load import accepted_range, drive_path, load_drive, parse_drive, shipped_drives
from model.loop.injection import RIPPLE
from model.rating import mtpa_currents
from runtime.design.cost import priced
from runtime.design.facts import EXAMPLE, SECTIONS, Facts, parse_facts, read_facts
from runtime.design.known import (
    HIDING_SIGMAS,
    LEAST_SHARE,
    active_flux,
    adaptive_time,
    doubted_flux,
    filter_bandwidth,
    inductance_bandwidth,
    rated_point,
    resistance_hurts,
    unknown_share,
)
from runtime.design.rules import CURRENT_TURN, SPEED_TO_CURRENT, design
from runtime.design.write import drive_text, edit_drive, toml_value
from runtime.system.errors import UserError
from tests.conftest import shipped_c
from tests.model.accepted import evenly

pytestmark = pytest.mark.unit

DATA = Path(__file__).parents[1] / "data"
FACTS = sorted((DATA / "facts").glob("*.toml"))
HELD_OUT = sorted((DATA / "facts_held_out").glob("*.toml"))


def with_(**sections: dict[str, Any]) -> dict[str, Any]:
    """The example's tables with some keys replaced; None takes one away."""
    tables = copy.deepcopy(EXAMPLE)
    for section, keys in sections.items():
        table = tables.setdefault(section, {}) | keys
        tables[section] = {key: value for key, value in table.items() if value is not None}
    return tables


# --- conversions, by the terminals of a motor written out


def terminal_emf(p: int, psi_m: float, omega: float) -> np.ndarray:
    """Voltage between two terminals of a turning motor without current, from the flux of its phases; one turn."""
    theta = np.linspace(0.0, 2 * np.pi, 20_000, endpoint=False)
    a, b = psi_m * np.cos(theta), psi_m * np.cos(theta - 2 * np.pi / 3)
    return np.asarray(np.gradient(a - b, theta[1] - theta[0])[1:-1] * p * omega)


@pytest.mark.parametrize("seed", range(5))
def test_back_emf_constants_are_what_a_voltmeter_at_the_terminals_shows(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p, psi_m = int(rng.integers(1, 20)), 10 ** rng.uniform(-3, 0)
    emf = terminal_emf(p, psi_m, 1000 * 2 * math.pi / 60)
    ke = math.sqrt(np.mean(emf**2))
    kv = 1000 / np.max(np.abs(emf))
    for stated in ({"ke_v_per_krpm": ke}, {"kv_rpm_per_v": kv}):
        motor = {"magnet_flux": None, "pole_pairs": None, "poles": 2 * p, **stated}
        assert parse_facts(with_(motor=motor), "x").psi_m == pytest.approx(psi_m, rel=1e-4)


def test_between_two_terminals_lie_two_phases() -> None:
    facts = parse_facts(with_(motor={"stator_resistance": None, "line_resistance": 0.7, "line_inductance": 3e-3}), "x")
    i = 2.0  # through a and back through b: heat and field energy of the terminals' values and of the phases'
    phases = np.array([i, -i, 0.0])
    assert 0.7 * i**2 == pytest.approx(facts.R * np.sum(phases**2))
    alpha = np.array([2 / 3, -1 / 3, -1 / 3]) @ phases
    beta = np.array([0, 1, -1]) @ phases / math.sqrt(3)
    assert 0.5 * 3e-3 * i**2 == pytest.approx(1.5 * 0.5 * facts.L_d * (alpha**2 + beta**2))
    assert facts.L_d == facts.L_q


def test_nameplate_speed_and_power() -> None:
    stated = with_(rated={"torque": None, "power": 47.0, "speed_rpm": None, "speed": 310.0})
    facts = parse_facts(stated, "x")
    assert facts.torque * facts.speed == pytest.approx(47.0)
    assert parse_facts(EXAMPLE, "x").speed == pytest.approx(3000 / 60 * 2 * math.pi)


def test_defaults_are_those_of_the_docs() -> None:
    facts = parse_facts(EXAMPLE, "x")
    assert (facts.d_R, facts.d_L, facts.d_psi, facts.d_J) == (0.2, 0.1, 0.05, 0.2)
    assert (facts.D, facts.dead_time, facts.bits, facts.step_every) == (0.0, 0.0, 12, 0.3)
    assert facts.noise == pytest.approx(1e-3 * facts.range)
    assert facts.angle == pytest.approx(math.radians(30))
    assert parse_facts(with_(start={"angle": "unknown"}), "x").angle == pytest.approx(math.pi)
    period = parse_facts(with_(inverter={"sample_time": None, "pwm_frequency": 8e3}), "x").T
    assert period == pytest.approx(125e-6)
    assert facts.sigma**2 == pytest.approx(facts.noise**2 + (40 / 4096) ** 2 / 12)


@pytest.mark.parametrize(
    ("sections", "said"),
    [
        ({"motor": {"stator_resistance": 3000.0}}, "motor.stator_resistance = 3000.0 ohm is outside 1e-05 .. 1000 ohm"),
        ({"motor": {"line_inductance": 200.0}}, "Did you mean 200 mH = 0.2?"),
        ({"motor": {"line_resistance": 0.6}}, "motor.stator_resistance and motor.line_resistance state the same"),
        ({"motor": {"magnet_flux": None}}, "motor.magnet_flux or motor.ke_v_per_krpm or motor.kv_rpm_per_v is missing"),
        ({"motor": {"line_inductance": None, "inductance_d": 1e-3}}, "motor.inductance_q is missing"),
        ({"motor": {"poles": 7, "pole_pairs": None}}, "motor.poles = 7"),
        ({"motor": {"pole_pairs": 4.5}}, "motor.pole_pairs = 4.5"),
        ({"motor": {"inertia": None}}, "motor.inertia is missing (1e-11 .. 1e+08 kg m^2)"),
        ({"motor": {"inertai": 1.0}}, "unknown key motor.inertai. Did you mean 'inertia'?"),
        ({"rated": {"power": 30.0}}, "rated.torque and rated.power state the same"),
        ({"inverter": {"pwm_frequency": 1e4}}, "inverter.sample_time and inverter.pwm_frequency state the same"),
        ({"inverter": {"dead_time": 5e-5}}, "more than a fifth of the sample time"),
        ({"start": {"angle": "anywhere"}}, "start.angle = 'anywhere'"),
        ({"start": {"angle": 200.0}}, "start.angle = 200.0 degrees is outside 0 .. 180 degrees"),
        ({"tolerance": {"inertia": 20.0}}, "tolerance.inertia = 20.0"),
        ({"motors": {"inertia": 20.0}}, "unknown key motors. Did you mean 'motor'?"),
    ],
)
def test_bad_facts_are_one_line_that_names_the_key(sections: dict[str, Any], said: str) -> None:
    with pytest.raises(UserError) as caught:
        parse_facts(with_(**sections), "mine.toml")
    message = str(caught.value)
    assert message.startswith("facts 'mine.toml': ")
    assert said in message
    assert "\n" not in message


def test_a_file_that_cannot_be_read_is_said(tmp_path: Path) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text("[motor")
    latin = tmp_path / "latin.toml"
    latin.write_bytes(b'name = "x"\n# 5 \xb5s')
    none = tmp_path / "none.toml"
    for path, said in ((bad, "not valid TOML"), (none, "cannot be read"), (latin, "line 2 is no UTF-8")):
        with pytest.raises(UserError, match=said):
            read_facts(path)


# --- rules


def drawn(rng: np.random.Generator) -> Facts | None:
    """Facts drawn over all that is accepted, each key by itself; None where they do not fit each other."""
    keys = {
        "motor": ("stator_resistance", "inductance_d", "inductance_q", "magnet_flux", "inertia"),
        "rated": ("speed", "torque", "max_current"),
        "inverter": ("dc_link", "sample_time"),
        "sensor": ("range",),
        "load": ("step_every",),
    }
    tables: dict[str, Any] = {"name": "drawn"}
    for section, names in keys.items():
        tables[section] = {name: evenly(rng, *bounds(section, name)) for name in names}
    tables["motor"]["pole_pairs"] = int(evenly(rng, 1, 200))
    if rng.random() < 0.5:
        tables["motor"]["inductance_q"] = tables["motor"]["inductance_d"]
    tables["tolerance"] = {
        key: float(rng.uniform(0, 0.5)) for key in ("stator_resistance", "inductance", "magnet_flux", "inertia")
    }
    tables["inverter"]["dead_time"] = min(1e-4, tables["inverter"]["sample_time"] * rng.uniform(0, 0.1))
    tables["start"] = {"angle": "unknown" if rng.random() < 0.25 else float(rng.uniform(0, 180))}
    return parse_facts(tables, "drawn")


def bounds(section: str, key: str) -> tuple[float, float]:
    """The closed range of a facts file's key."""
    _, low, high = accepted_range(SECTIONS[section], key)
    assert low is not None
    assert high is not None
    return low, high


def test_rules_make_an_accepted_drive_of_any_accepted_facts() -> None:
    rng = np.random.default_rng(1)
    for _ in range(300):
        facts = drawn(rng)
        assert facts is not None
        chosen = design(facts)
        drive = parse_drive(chosen.tables(), "drawn")
        control, tuning = drive.control, drive.filter
        assert all(value > 0 for value in (*tuning.process_noise, *tuning.initial_covariance))
        if control.current_bandwidth > 0.1:  # the least that a drive file accepts
            assert control.current_bandwidth * facts.T <= CURRENT_TURN * 1.01
            assert control.speed_bandwidth <= max(0.1, SPEED_TO_CURRENT * control.current_bandwidth * 1.01)
        assert drive.operating_box.current >= min(facts.max_current, 1e5)
        assert drive.operating_box.speed >= min(facts.speed, 3e4)
        assert drive.rated is not None
        assert all(choice.reason for section in chosen.sections.values() for choice in section.values())
        assert tomllib.loads(drive_text(chosen, "facts.toml")) == chosen.tables()


@pytest.mark.parametrize("path", FACTS, ids=[path.stem for path in FACTS])
def test_less_certain_facts_make_a_less_certain_filter(path: Path) -> None:
    facts = read_facts(path)
    point = rated_point(facts)
    assert unknown_share(facts, point) >= LEAST_SHARE
    for more in ("d_psi", "d_L", "dead_time"):
        doubled = replace(facts, **{more: 2 * getattr(facts, more)})
        assert unknown_share(doubled, point) > unknown_share(facts, point)
    exact = replace(facts, d_R=0.0, d_L=0.0, d_psi=0.0, dead_time=0.0)
    assert unknown_share(exact, point) == pytest.approx(LEAST_SHARE)
    assert not resistance_hurts(exact, point)


def test_the_resistance_is_adapted_where_it_hurts_and_only_there() -> None:
    found = {path.stem: design(read_facts(path)).sections["model"]["adaptive"].value for path in FACTS}
    assert found["fan"] == found["gimbal"] == ["stator_resistance"]
    assert found["mill"] == found["wind"] == []
    fan = read_facts(next(path for path in FACTS if path.stem == "fan"))
    assert design(replace(fan, d_R=0.02)).sections["model"]["adaptive"].value == []


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"T": 1e-3}, "a sample of 1e+03 us is long"),
        ({"dc_link": 12.0}, "takes field weakening"),
        ({"torque": 2.0}, "more than rated.max_current"),
        ({"range": 5.0}, "does not cover"),
    ],
)
def test_facts_that_do_not_fit_each_other_are_remarked(changed: dict[str, float], said: str) -> None:
    facts = parse_facts(EXAMPLE, "x")
    assert design(facts).remarks == []
    assert any(said in line for line in design(replace(facts, **changed)).remarks)


def test_facts_that_no_drive_file_holds_are_bad_input() -> None:
    facts = parse_facts(with_(motor={"magnet_flux": None, "kv_rpm_per_v": 9e5}), "x")
    with pytest.raises(UserError, match=r"motor\.magnet_flux"):
        design(facts)


@pytest.mark.parametrize("path", FACTS, ids=lambda path: path.stem)
def test_the_inverter_is_in_the_drive_file_where_there_is_dead_time(path: Path) -> None:
    """Its currents: one that V_d drives through the inductance in a sample, never within noise or, at rest, ripple."""
    facts = read_facts(path)
    section = {key: choice.value for key, choice in design(facts).sections["inverter"].items()}
    driven = facts.dc_link * facts.dead_time / min(facts.L_d, facts.L_q)
    assert section["dead_time"] == facts.dead_time
    assert section["switching_frequency"] == pytest.approx(1 / facts.T)
    ripple = 0.0 if facts.L_d == facts.L_q else RIPPLE * rated_point(facts).current
    assert section["fading_current"] == pytest.approx(max(3 * facts.sigma, driven, ripple / 1.5), rel=5e-3)
    assert section["compensation_current"] == pytest.approx(max(3 * facts.sigma, 0.6 * driven), rel=5e-3)
    assert "inverter" not in design(replace(facts, dead_time=0.0)).sections


def test_the_speed_loop_heeds_a_wrong_inductance_where_that_would_shake_it() -> None:
    """Of a lift the inductance decides; known exactly, it does not; a quarter of the inertia doubles the limit."""
    lift = read_facts(next(path for path in FACTS if path.stem == "lift"))
    point = rated_point(lift)
    limit = inductance_bandwidth(lift, point)
    assert design(lift).sections["control"]["speed_bandwidth"].value == pytest.approx(limit, rel=5e-3)
    assert "inductance within 10%" in design(lift).sections["control"]["speed_bandwidth"].reason
    assert math.isinf(inductance_bandwidth(replace(lift, d_L=0.0), point))
    lighter = replace(lift, J=lift.J / 4)  # the filter follows twice as fast
    assert inductance_bandwidth(lighter, point) == pytest.approx(2 * limit)
    gain = 2 * lift.J * limit * lift.d_L * lift.L_q * filter_bandwidth(lift, point)
    assert gain / (1.5 * (lift.p * active_flux(lift, point)) ** 2) == pytest.approx(0.5)


def test_a_reluctance_machine_gets_no_more_current_than_the_voltage_can_turn() -> None:
    """On the MTPA curve, where omega_e L_q i_q takes the voltage; the other motors keep what their facts say."""
    ferrite = read_facts(next(path for path in HELD_OUT if path.stem == "ferrite"))
    chosen = design(ferrite)
    drive = parse_drive(chosen.tables(), "x")
    _, i_q = mtpa_currents(drive, drive.control.max_current)
    assert ferrite.omega_e * ferrite.L_q * i_q == pytest.approx(ferrite.voltage, rel=1e-4)
    assert any("takes the whole voltage at rated speed" in line for line in chosen.remarks)
    for path in FACTS:
        assert design(read_facts(path)).sections["control"]["max_current"].value == read_facts(path).max_current


@pytest.mark.parametrize("path", FACTS, ids=lambda path: path.stem)
def test_a_magnet_is_doubted_for_what_noise_does_not_hide(path: Path) -> None:
    """As much as hides it: half is left. A tenth of that: next to nothing; ten times: nearly all."""
    facts = read_facts(path)
    back_emf = terminal_emf(facts.p, facts.psi_m, facts.speed).max() / math.sqrt(3)
    hiding = HIDING_SIGMAS * LEAST_SHARE * facts.dc_link / math.sqrt(3) / back_emf
    shares = [doubted_flux(replace(facts, d_psi=times * hiding)) / (times * hiding) for times in (0.1, 1.0, 10.0)]
    assert shares == pytest.approx([1 / 101, 1 / 2, 100 / 101], rel=1e-4)


def test_an_adapted_resistance_remembers_twenty_run_ups() -> None:
    facts = parse_facts(EXAMPLE, "x")
    assert adaptive_time(replace(facts, J=1e-4)) == pytest.approx(20 * 1e-4 * facts.speed / facts.torque, rel=5e-3)
    assert adaptive_time(replace(facts, J=1e-9)) == 0.3


@pytest.mark.parametrize("path", FACTS + HELD_OUT, ids=lambda path: path.stem)
def test_the_motors_that_designs_are_tried_on_could_be_built(path: Path) -> None:
    """The rated point is within voltage and current, copper loss a part of the power, the sample fits the motor."""
    facts = read_facts(path)
    point = rated_point(facts)
    assert facts.name == path.stem
    assert facts.omega_e * facts.psi_m < 0.9 * facts.voltage
    assert point.base_speed > 1.1 * facts.speed
    assert point.current < 0.75 * facts.max_current <= 0.75 * facts.range
    assert 1.5 * facts.R * point.current**2 < 0.5 * facts.torque * facts.speed
    assert facts.omega_e * facts.T < 0.33
    assert facts.dead_time < 0.035 * facts.T
    assert (facts.d_R, facts.d_L, facts.d_psi, facts.d_J) == (0.2, 0.1, 0.05, 0.2)


def test_the_motors_held_out_are_others() -> None:
    assert len(FACTS) >= 18
    assert len(HELD_OUT) >= 10
    known = [read_facts(path) for path in FACTS]
    for path in HELD_OUT:
        new = read_facts(path)
        assert all((new.R, new.psi_m, new.J) != (old.R, old.psi_m, old.J) for old in known)


# --- what is written


def test_the_written_file_loads_as_the_rules_meant_it(tmp_path: Path) -> None:
    for path in FACTS:
        chosen = design(read_facts(path))
        text = drive_text(chosen, path.name)
        (tmp_path / "d.toml").write_text(text)
        assert load_drive(tmp_path / "d.toml").model_dump(exclude={"sha256"}) == parse_drive(
            chosen.tables(), "x"
        ).model_dump(exclude={"sha256"})
        lines = text.splitlines()
        assert max(len(line) for line in lines) <= 150
        for k, line in enumerate(lines):
            if " = " in line and not line.startswith(("#", "name")):
                assert " # " in line or lines[k - 1].startswith("# "), line


def test_values_are_written_to_the_last_digit() -> None:
    for value in (0.1, 1e-9, 123456.789, 7, True, 'a"b', ["x", "y"], [1e-300, 2.0]):
        assert tomllib.loads(f"v = {toml_value(value)}".replace("True", "true"))["v"] == value


def test_shipped_drives_that_were_designed_are_what_their_facts_give() -> None:
    """Where a rule changes: ``pmsm-ickf design tests/data/facts/X.toml --out model/drives/X.toml``, then generate."""
    designed = [path for path in FACTS if path.stem in shipped_drives()]
    assert len(designed) == 3
    for path in designed:
        shipped = Package(
            load_drive(path.stem), None, {}, shipped_c(path.stem)
        )  # if it is another drive, so is its text
        text = drive_text(priced(design(read_facts(path)), shipped), path.name)
        assert drive_path(path.stem).read_text() == text


def test_an_existing_file_keeps_its_comments_and_what_is_not_ours(tmp_path: Path) -> None:
    facts = parse_facts(EXAMPLE, "x")
    path = tmp_path / "example.toml"
    path.write_text(
        "# Hers, not ours\n"
        + drive_text(design(facts), "x.toml")
        .replace("[motor]", "# measured cold\n[motor]")
        .replace("stator_resistance = 0.3 ", "stator_resistance = 0.4 # by Anna;")
        + "\n[budget]\nk = 4.0 # a slow flash\n"
    )
    text = edit_drive(design(facts), path)
    for kept in ("# Hers, not ours", "# measured cold", "k = 4.0 # a slow flash", "by Anna"):
        assert kept in text
    assert tomllib.loads(text)["motor"]["stator_resistance"] == 0.3
    path.write_text(text)
    assert edit_drive(design(facts), path) == text
    again = edit_drive(design(replace(facts, R=0.35)), path)
    assert again.count("now:") == 1
    assert "by Anna" in again


@pytest.mark.parametrize(
    ("text", "said"),
    [('name = "other"\n', "drive file of 'other'"), ("[motor", "not valid TOML"), (None, "cannot be read")],
)
def test_a_file_that_cannot_be_edited_is_said(tmp_path: Path, text: str | None, said: str) -> None:
    path = tmp_path / "example.toml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(UserError, match=said):
        edit_drive(design(parse_facts(EXAMPLE, "x")), path)
