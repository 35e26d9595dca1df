"""The command ``identify``: what it says, writes and refuses."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from benchmarks.identify import subject
from benchmarks.other_motor import MOTORS, recordings
from runtime.identify import search as search_module
from runtime.identify.identify import identify
from runtime.identify.redesign import compare
from runtime.identify.rows import rows_of
from runtime.recorded.data import write_recorded
from tests.runtime.test_cli import call
from tests.runtime.test_identify import FREE, cut, pump

FACTS = """\
# a pump
name = "pump"
[motor]
line_resistance = 10.0   # a cheap meter
inductance_d = 30e-3
inductance_q = 60e-3
ke_v_per_krpm = 180.0    # the label
pole_pairs = 3
inertia = 0.02
[rated]
speed = 104.7
torque = 5.0
max_current = 15.0
[inverter]
dc_link = 540.0
sample_time = 100e-6
[sensor]
range = 37.5
bits = 16
noise = 0.05
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("identify")
    recording = recordings(MOTORS["pump"], 1, 0.2)[0]
    i, u = recording.y, recording.u
    columns = {"t": recording.t, "u_alpha": u[:, 0], "u_beta": u[:, 1], "i_alpha": i[:, 0], "i_beta": i[:, 1]}
    write_recorded(folder / "run.npz", {**columns, **recording.truth})
    (folder / "facts.toml").write_text(FACTS, encoding="utf-8")
    (folder / "copy.toml").write_text(FACTS, encoding="utf-8")
    return folder


@pytest.mark.slow
def test_the_command_writes_what_it_found(files: Path) -> None:
    given = [str(files / "facts.toml"), str(files / "run.npz"), "--free", FREE]
    out = call("identify", *given, "--json", str(files / "f.json"), "--write", str(files / "copy.toml"), cwd=files)
    assert out.returncode == 0, out.stderr
    facts = json.loads((files / "f.json").read_text(encoding="utf-8"))
    m = MOTORS["pump"]
    true = {"stator_resistance": m.R, "inductance_d": m.L_d, "inductance_q": m.L_q, "magnet_flux": m.psi_m}
    for key, value in {**true, "inertia": m.J}.items():
        entry = facts["parameters"][key]
        assert entry["low"] < entry["value"] < entry["high"]
        assert entry["told"]
        assert entry["value"] == pytest.approx(value, rel=0.02)
    assert facts["filters"][0]["after"]["position, rms at the end"] < 2.0
    text = (files / "copy.toml").read_text(encoding="utf-8")
    assert "# a pump" in text
    assert "a cheap meter; now: identified" in text
    from runtime.design.facts import read_facts

    written = read_facts(files / "copy.toml")
    assert pytest.approx(facts["parameters"]["stator_resistance"]["value"], rel=1e-5) == written.R
    assert written.psi_m == pytest.approx(facts["parameters"]["magnet_flux"]["value"], rel=1e-5)
    assert written.d_R == 0.01
    assert (files / "facts.toml").read_text(encoding="utf-8") == FACTS


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--free", "R,X"], "no such datum"),
        (["--free", "L"], "two inductances"),
        (["--free", "D"], "stated as 0"),
        (["--free", "R,R"], "twice"),
        (["--write", "somewhere.txt"], "ends in .toml"),
    ],
)
def test_what_cannot_be_asked_is_told_in_one_line(files: Path, more: list[str], said: str) -> None:
    out = call("identify", str(files / "facts.toml"), str(files / "run.npz"), *more, cwd=files)
    assert out.returncode == 2
    assert said in out.stderr
    assert len(out.stderr.strip().splitlines()) == 1


def test_too_short_a_recording_is_refused(files: Path) -> None:
    truth, recording = pump()
    short = cut(recording, slice(0, 50))
    from runtime.system.errors import UserError

    with pytest.raises(UserError, match="50 measured rows"):
        rows_of(short, truth.T, truth.dc_link, "pump")
    assert math.isclose(truth.T, 1e-4)


@pytest.mark.slow
def test_both_filters_begin_at_the_speed_that_was_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """A recording that begins with a turning rotor: from rest neither would be near it in the first samples."""
    monkeypatch.setattr(search_module, "STARTS", 1)
    truth, recording = pump()
    turning = cut(recording, slice(2200, 2600))
    both = compare(identify(subject(truth, truth, False, "psi_m"), [turning]))
    for run in (both.before[0], both.after[0]):
        off = run.x[:20, run.state_names.index("omega")] - turning.truth["omega"][:20]
        assert abs(off).max() < 0.05 * truth.speed
