"""Commissioning from the host: a simulated motor behind a switching inverter with dead time, 12 bits, offsets."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from model.drives.load import load_drive
from runtime.board.link import Port, SerialPort
from runtime.commission.commission import Commissioned, commission
from runtime.commission.electrical import axes, d_is_smaller
from runtime.commission.intervals import of_values
from runtime.commission.line import Bench as Board
from runtime.commission.line import Ran
from runtime.commission.lost import Inverter, followed_loss, mean_sign_loss
from runtime.commission.plan import KEPT, LEVELS, Bench, Limits, at_rest, turning
from runtime.commission.protocol import Run
from runtime.commission.session import check_board, limits_of
from runtime.commission.simulated import SimulatedMotor, Truth
from runtime.design.facts import Facts, read_facts
from runtime.recorded.data import read_recorded
from runtime.system.errors import UserError
from tests.target.command import call

pytestmark = pytest.mark.skipif(os.name != "posix", reason="not run: pseudo-terminals need a POSIX system")

FACTS = Path(__file__).parents[1] / "data" / "facts"
SERVO = read_facts(FACTS / "servo_24v.toml")
#: Every fact of the servo wrong, by up to a half.
WRONG = {"0.3": "0.42", "0.25e-3": "0.15e-3", "0.007": "0.0105", "1e-5": "0.5e-5", "2e-6": "1e-6"}


def wrong_facts(folder: Path, **changes: str) -> Path:
    text = (FACTS / "servo_24v.toml").read_text()
    for true, stated in WRONG.items():
        text = text.replace(f"= {true}\n", f"= {stated}\n")
    for key, value in changes.items():
        lines = [f"{key} = {value}" if line.startswith(f"{key} =") else line for line in text.splitlines()]
        text = "\n".join(lines) + "\n"
    path = folder / "facts.toml"
    path.write_text(text)
    return path


def run(truth: Truth, believed: Facts) -> Commissioned:
    with SimulatedMotor(truth) as simulated:
        port = SerialPort(simulated.port, 115200)
        limits = limits_of(believed, None, None)
        found = commission(
            Board(port, 115200), believed, limits, lambda: False, lambda text, share: None, lambda ran: None
        )
        port.close()
    return found


def test_the_command_finds_a_motor_of_which_everything_stated_is_wrong(tmp_path: Path) -> None:
    facts = wrong_facts(tmp_path)
    words = ("--port", "simulated", "--facts", facts.name, "--motor", str(FACTS / "servo_24v.toml"))
    words += ("--out", "run.npz", "--write", facts.name, "--drive", "my.toml", "--json", "f.json")
    done = call("commission", *words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr + done.stdout
    found = json.loads((tmp_path / "f.json").read_text())
    true = {"stator_resistance": (SERVO.R, 0.005), "magnet_flux": (SERVO.psi_m, 0.01), "inertia": (SERVO.J, 0.03)}
    true |= {"inductance_d": (SERVO.L_d, 0.015), "inductance_q": (SERVO.L_q, 0.015)}
    true["dead_time_voltage"] = (SERVO.dc_link * SERVO.dead_time / SERVO.T, 0.03)
    for key, (value, share) in true.items():
        one = found["parameters"][key]
        assert one["told"]
        assert one["value"] == pytest.approx(value, rel=share), key
        assert one["low"] < value < one["high"], key
    written = read_facts(facts)
    assert found["parameters"]["stator_resistance"]["value"] == pytest.approx(written.R, rel=1e-5)
    assert load_drive(tmp_path / "my.toml").motor.magnet_flux == pytest.approx(SERVO.psi_m, rel=0.01)
    recorded = read_recorded(tmp_path / "run.npz")
    assert len(recorded.t) > 5000
    assert np.all(np.diff(recorded.t) > 0)
    assert np.max(np.hypot(*recorded.y.T)) < SERVO.max_current


def test_a_current_that_the_voltage_does_not_give_is_said(tmp_path: Path) -> None:
    """Half of 150 A through 0.3 ohm takes more than the link has: no number, but the reason."""
    (tmp_path / "true.toml").write_text(
        (FACTS / "servo_24v.toml").read_text().replace("max_current = 10.0", "max_current = 150.0")
    )
    facts = wrong_facts(tmp_path, max_current="150.0")
    words = ("--port", "simulated", "--facts", facts.name, "--motor", "true.toml", "--json", "f.json")
    done = call("commission", *words, cwd=tmp_path)
    assert done.returncode == 1, done.stderr + done.stdout
    found = json.loads((tmp_path / "f.json").read_text())["parameters"]
    for key in ("stator_resistance", "dead_time_voltage"):
        assert found[key]["value"] is None
        assert not found[key]["told"]
        assert "current not reached" in found[key]["why"]
    assert not any(one["told"] for one in found.values())


def test_ctrl_c_switches_off_and_keeps_what_came(tmp_path: Path) -> None:
    facts = wrong_facts(tmp_path)
    root = str(Path(__file__).parents[2])
    words = [sys.executable, "-m", "runtime.cli", "commission", "--port", "simulated", "--facts", facts.name]
    words += ["--motor", str(FACTS / "servo_24v.toml"), "--out", "run.npz", "--json", "f.json"]
    process = subprocess.Popen(
        words, cwd=tmp_path, env={**os.environ, "PYTHONPATH": root}, stdout=subprocess.PIPE, text=True
    )
    while not (tmp_path / "run.npz").exists() and process.poll() is None:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=60)
    assert process.returncode == 130, out
    assert "the inverter is off" in out
    assert len(read_recorded(tmp_path / "run.npz").t) > 500
    said = json.loads((tmp_path / "f.json").read_text())
    assert said["parameters"]["inertia"]["why"] == "stopped"
    assert said["ended"] == "stopped"


def test_a_trip_is_told_and_ends_everything(tmp_path: Path) -> None:
    """Of a motor of which half the stated limit is all that may flow, the board's own limit decides."""
    truth = Truth(replace(SERVO, range=20.0), offset=(5.0, 5.0))  # sensors that show 10 A where none flows
    found = run(truth, replace(SERVO, max_current=9.0))
    assert found.ended == "the board ended 'at rest, to learn': a phase current was beyond its limit"
    assert not found.told
    assert set(found.why.values()) == {found.ended}


class LossyPort(SerialPort):
    """A port that loses some bytes of the first run's rows."""

    def __init__(self, name: str, baud: int) -> None:
        super().__init__(name, baud)
        self.passed = 0

    def read(self) -> bytes:
        data = super().read()
        before, self.passed = self.passed, self.passed + len(data)
        return data[:-20] if before < 5000 <= self.passed else data


def test_a_run_of_which_frames_were_lost_is_made_again() -> None:
    runs: list[Ran] = []
    with SimulatedMotor(Truth(SERVO)) as simulated:
        port = LossyPort(simulated.port, 115200)
        found = commission(  # stopped once the first run is whole
            Board(port, 115200),
            SERVO,
            limits_of(SERVO, None, None),
            lambda: len(runs) > 1,
            lambda text, share: None,
            runs.append,
        )
        port.close()
    assert [ran.whole for ran in runs] == [False, True, False]
    assert runs[0].lost > 0
    assert found.stopped
    assert found.told["R"].value == pytest.approx(SERVO.R, rel=0.005)


class DeadPort:
    """Nobody is there."""

    def read(self) -> bytes:
        time.sleep(0.005)
        return b""

    def write(self, data: bytes) -> None: ...

    def close(self) -> None: ...


def test_no_board_is_one_line() -> None:
    port: Port = DeadPort()
    with pytest.raises(UserError, match="no answer from the board"):
        Board(port, 115200, timeout=0.02)


def test_a_board_of_another_sample_time_or_tighter_limits_is_refused() -> None:
    with SimulatedMotor(Truth(SERVO)) as simulated:
        port = SerialPort(simulated.port, 115200)
        board = Board(port, 115200)
        check_board(board, SERVO, Limits(10.0, SERVO.speed))
        with pytest.raises(UserError, match=r"samples every 0\.0001 s"):
            check_board(board, replace(SERVO, T=5e-5), Limits(10.0, 1.0))
        with pytest.raises(UserError, match="firmware allows 10 A"):
            check_board(board, SERVO, Limits(11.0, 1.0))
        with pytest.raises(UserError, match="--max-speed"):
            check_board(board, SERVO, Limits(10.0, 2 * SERVO.speed))
        port.close()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--max-current", "11"), "beyond rated.max_current"),
        (("--max-speed", "3001"), "beyond the rated speed"),
        (("--out", "run.csv"), "is .npz"),
        (("--drive", "facts.toml"), "'facts.toml' exists"),
        (("--out", "there.npz"), "'there.npz' exists"),
        (("--port", "/dev/none", "--motor", "facts.toml"), "goes with --port simulated"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_turns(words: tuple[str, ...], said: str, tmp_path: Path) -> None:
    facts = wrong_facts(tmp_path)
    (tmp_path / "there.npz").touch()
    port = () if "--port" in words else ("--port", "simulated")
    done = call("commission", *port, "--facts", facts.name, *words, cwd=tmp_path)
    assert done.returncode == 2
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1


# --- plans


def every_plan(facts: Facts) -> list[Run]:
    bench = Bench(facts, limits_of(facts, None, None), every=41, rows=384)
    seen, known = replace(bench, seen=True), replace(bench, seen=True, known=True)
    return [at_rest(bench), turning(seen), at_rest(known), turning(known, 0.25)]


@pytest.mark.parametrize("path", sorted(FACTS.glob("*.toml")), ids=lambda path: path.stem)
@pytest.mark.parametrize("seed", range(3))
def test_plans_keep_within_the_limits_whatever_the_facts_say(path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    f = read_facts(path)
    off = dict(zip(("R", "L_d", "L_q", "psi_m", "J"), rng.uniform(0.5, 1.5, 5), strict=True))
    facts = replace(f, **{name: getattr(f, name) * factor for name, factor in off.items()})
    for plan in every_plan(facts):
        assert len(plan.segments) <= 40
        assert plan.current_limit == facts.max_current
        assert max(abs(s.current) for s in plan.segments) <= LEVELS[-1] * facts.max_current * (1 + 1e-12)
        assert max(abs(s.speed) for s in plan.segments) <= facts.omega_e
        assert plan.segments[-1].current == 0.0
        assert plan.segments[-1].speed == 0.0
        assert all(1 <= s.ramp <= s.samples for s in plan.segments)
        assert sum(s.samples for s in plan.segments if s.every == 1) <= 6 * 382
        assert math.isfinite(plan.samples)


def test_a_strongly_salient_rotor_is_kept_on_its_axis() -> None:
    f = read_facts(FACTS / "reluctance.toml")
    leaves = f.psi_m / (f.L_q - f.L_d)
    for plan in every_plan(f)[2:]:
        assert max(s.current for s in plan.segments) <= KEPT * leaves * (1 + 1e-12)


# --- estimates


def matrix(L_d: float, L_q: float, beside: float) -> np.ndarray:
    c, s = math.cos(beside), math.sin(beside)
    turn = np.array([[c, -s], [s, c]])
    return np.asarray(turn @ np.diag([L_d, L_q]) @ turn.T)


@pytest.mark.parametrize(
    ("L_d", "L_q", "high", "low", "smaller"),
    [
        (1e-3, 1e-3, 0.0, 0.0, None),
        (1e-3, 1.5e-3, 0.02, 0.01, True),
        (1.5e-3, 1e-3, 0.02, 0.01, False),  # flux-intensifying: d has the larger one
        (5e-3, 22e-3, 1.17, 0.0, True),  # the large current drove the rotor off its axis
        (5e-3, 22e-3, 1.45, 1.0, True),  # so far that q nearly lies along it
    ],
)
def test_d_and_q_are_told_apart(L_d: float, L_q: float, high: float, low: float, smaller: bool | None) -> None:
    assert d_is_smaller(matrix(L_d, L_q, high), matrix(L_d, L_q, low)) == smaller
    each = np.array([matrix(L_d, L_q, high), matrix(L_d, L_q, -high)])
    found = axes(each, smaller)
    np.testing.assert_allclose(found.L_d, L_d)
    np.testing.assert_allclose(found.L_q, L_q)


def test_an_interval_holds_scatter_and_what_the_model_leaves_out() -> None:
    same = of_values("R", np.array([1.0, 1.0, 1.0]))
    assert (same.low, same.high) == pytest.approx((0.997, 1.003))
    assert same.surely
    apart = of_values("R", np.array([0.9, 1.0, 1.1]))
    assert apart.high - 1.0 == pytest.approx(4.303 * 0.1 / math.sqrt(3), rel=1e-3)
    assert not apart.surely
    assert not of_values("V_dead", np.array([-1.0, -1.0])).surely
    assert of_values("psi_m", np.array([1.0, 1.0]), more=0.02).width == pytest.approx(math.hypot(0.004, 0.02))


def test_what_a_large_current_loses_is_known_in_closed_form() -> None:
    """A sinusoidal current without ripple loses 4 / pi V_d along itself; followed edge by edge it is the same."""
    n, T, omega = 3000, 1e-4, 200.0
    rows = np.zeros((n, 8))
    rows[:, 0] = np.arange(n)
    rows[:, 2], rows[:, 3], rows[:, 4] = 2.0, 1.0, 5.0
    rows[:, 6] = omega
    rows[:, 7] = np.mod(omega * T * np.arange(n) + math.pi, 2 * math.pi) - math.pi
    V_d = 24.0 * 2e-6 / T
    assert mean_sign_loss(rows, V_d, T).mean() == pytest.approx(4 / math.pi * V_d, rel=2e-3)
    stiff = Inverter(24.0, T, 2e-6, 1.0, 1.0)  # so much inductance that there is no ripple
    assert followed_loss(rows, stiff) == pytest.approx(4 / math.pi * V_d, rel=1e-2)
    small = replace(stiff, L_d=1e-5, L_q=1e-5)  # so little that near zero the current passes it in every interval
    assert followed_loss(rows, small).real < 0.97 * 4 / math.pi * V_d
