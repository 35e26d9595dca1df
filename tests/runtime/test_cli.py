"""The command line: exit codes, one clear line for bad input, machine-readable output, a page to look at."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path

import pytest

from model.drives.load import DRIVES
from runtime.estimator.folder import GENERATED
from tests import forked
from tests.conftest import LINKS

#: One filter is enough to generate here.
PAPER = (DRIVES / "paper_spmsm.toml").read_text().replace('["ckf", "ickf"]', '["ckf"]')


def call(*arguments: str, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return forked.call(*arguments, cwd=cwd, environment=environment)


def test_own_motor_from_toml_to_folder(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(PAPER.replace("paper_spmsm", "my_motor").replace("2.875", "1.2"))
    done = call("generate", "mine.toml", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    folder = tmp_path / "generated" / "my_motor"
    assert (folder / "my_motor_ckf.c").is_file()
    assert call("generate", "mine.toml", "--check", cwd=tmp_path).returncode == 0
    (tmp_path / "mine.toml").write_text(PAPER.replace("paper_spmsm", "my_motor").replace("2.875", "1.3"))
    stale = call("generate", "mine.toml", "--check", cwd=tmp_path)
    assert stale.returncode == 1
    assert "-#define DECAY_I" in stale.stdout
    assert "+#define DECAY_I" in stale.stdout
    refused = call("verify", "mine.toml", cwd=tmp_path)
    assert refused.returncode == 2
    assert "is stale" in refused.stderr


@pytest.mark.thorough
def test_hand_edits_survive_generate(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(PAPER.replace("paper_spmsm", "mine"))
    assert call("generate", "mine.toml", "--out", "out", cwd=tmp_path).returncode == 0
    path = tmp_path / "out" / "mine" / "mine_ckf.c"
    edited = path.read_text().replace("0.25f", "0.26f", 1)
    path.write_text(edited)
    refused = call("generate", "mine.toml", "--out", "out", cwd=tmp_path)
    assert refused.returncode == 2
    assert "was edited by hand" in refused.stderr
    assert path.read_text() == edited
    assert call("generate", "mine.toml", "--out", "out", "--check", cwd=tmp_path).returncode == 1
    assert call("generate", "mine.toml", "--out", "out", "--force", cwd=tmp_path).returncode == 0


def test_a_shipped_name_is_not_taken_over(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(PAPER.replace("2.875", "1.2"))
    done = call("generate", str(tmp_path / "mine.toml"), cwd=GENERATED.parent)
    assert done.returncode == 2
    assert "belongs to a shipped drive" in done.stderr
    assert call("generate", "paper_spmsm", "--check", cwd=tmp_path).returncode == 0


def test_one_bad_drive_leaves_every_folder_alone(tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text(PAPER.replace("835e-6", "0.8"))
    done = call("generate", "paper_spmsm", "bad.toml", "--out", "out", cwd=tmp_path)
    assert done.returncode == 2
    assert not (tmp_path / "out").exists()


BAD = [
    (("generate", "no_such_drive"), "no drive 'no_such_drive'"),
    (("verify", "paper_spmsn"), "Did you mean 'paper_spmsm'?"),
    (("verify", "ipmsm_flux", "paper_spmsn"), "Did you mean 'paper_spmsm'?"),
    (("generate", "bad.toml"), "motor.inductance_d = 0.8 H is outside"),
    (("run", "bad.toml"), "Did you mean 0.8 mH = 0.0008?"),
    (("generate", "broken.toml"), "not valid TOML"),
    (("verify", "fine.toml"), "no generated folder"),
    (("generate", "paper_spmsm", "--out", "a_file"), "a_file"),
]


@pytest.mark.parametrize(("arguments", "expected"), BAD)
def test_bad_input_is_one_line_and_exit_2(arguments: tuple[str, ...], expected: str, tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text(PAPER.replace("paper_spmsm", "bad").replace("835e-6", "0.8"))
    (tmp_path / "broken.toml").write_text("[motor")
    (tmp_path / "fine.toml").write_text(PAPER.replace("paper_spmsm", "fine"))
    (tmp_path / "a_file").write_text("not a folder")
    done = call(*arguments, cwd=tmp_path)
    assert done.returncode == 2, done.stdout + done.stderr
    assert expected in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert "Traceback" not in done.stderr
    assert (tmp_path / "a_file").read_text() == "not a folder"


def test_no_compiler_is_said_before_work_starts(tmp_path: Path) -> None:
    done = call("verify", "paper_spmsm", cwd=tmp_path, CC="no-such-compiler")
    assert done.returncode == 2
    for words in ("the proof executes the generated C (link D-E): no C compiler: CC is", "replay --backend numpy"):
        assert words in done.stderr, words


@pytest.mark.thorough
def test_ones_own_motor_is_verified(tmp_path: Path) -> None:
    text = (DRIVES / "spmsm_load_torque.toml").read_text().replace("spmsm_load_torque", "my_motor")
    (tmp_path / "my_motor.toml").write_text(text.replace("2.875", "2.0").replace('["ckf", "ickf"]', '["ckf"]'))
    assert call("generate", "my_motor.toml", cwd=tmp_path).returncode == 0
    done = call("verify", "my_motor.toml", "--json", "proof.json", cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    data = json.loads((tmp_path / "proof.json").read_text())
    assert data["passed"] is True
    (drive,) = data["drives"]
    assert {link["name"] for link in drive["links"]} == LINKS
    assert all(row["worst"] <= row["allowed"] for link in drive["links"] for row in link["rows"])


@pytest.mark.slow
def test_run_shows_the_main_result(tmp_path: Path) -> None:
    """The first floor; its proof is the one that test_proof.py holds to its figures, made once for both."""
    done = call("run", "--build", "b", cwd=tmp_path, PMSM_ICKF_FRESH="")
    assert done.returncode == 0, done.stdout + done.stderr
    page = (tmp_path / "b" / "report" / "index.html").read_text()
    assert page.count("<svg") == 1 + 3 + 2 + 1  # the loop on the first screen; the proof, the scenarios, the modes
    assert "agree bit for bit: there is nothing to draw" in page
    assert "all links that could be run here hold" in page
    assert "were not run: <code>pmsm-ickf run --all" in page
    _needs_nothing(page)
    last = done.stdout.splitlines()[-3:]
    assert re.fullmatch(f"GOOD: paper_spmsm: generated; links {', '.join(sorted(LINKS))}; simulated", last[0])
    assert last[1].startswith("Not shown: every drive, ")
    assert last[1].endswith(" Run: pmsm-ickf run --all")
    assert last[2] == "Report: b/report/index.html"


def _needs_nothing(page: str) -> None:
    assert not re.findall(r"(?:src|href)=\"(?!#)", page), "nothing is fetched from elsewhere"


def test_help_and_version(tmp_path: Path) -> None:
    assert "generate" in call("--help", cwd=tmp_path).stdout
    assert re.fullmatch(r"\d+\.\d+\.\d+\n", call("--version", cwd=tmp_path).stdout)


def test_simulate_reports_saves_and_exits_well(tmp_path: Path) -> None:
    arguments = (
        "spmsm_load_torque",
        "--scenario",
        "load_step",
        "--filters",
        "ckf,ekf",
        "--json",
        "s.json",
        "--out",
        "o",
    )
    done = call("simulate", *arguments, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    data = json.loads((tmp_path / "s.json").read_text())
    assert [run["filter"] for run in data["runs"]] == ["ckf", "ekf"]
    assert all(run["locked"] for run in data["runs"])
    assert {path.name for path in (tmp_path / "o").iterdir()} == {
        "load_step_ckf.npz",
        "load_step_ekf.npz",
        "load_step.svg",
    }


def test_simulate_says_when_lock_is_lost(tmp_path: Path) -> None:
    done = call("simulate", "--theta", "3.1", "--alone", "--scenario", "no_load", "--filters", "ckf", cwd=tmp_path)
    assert done.returncode == 1
    assert "LOST LOCK" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("--scenario", "dance"), "no scenario 'dance'; there are: no_load, load_step"),
        (("--filters", "ckf,pf"), "no filter 'pf'; there are: ckf, ickf, ekf, ukf"),
        (("--inverter", "magic"), "no inverter 'magic'"),
        (("--controller", "rust"), "no controller 'rust'; there are: c, numpy"),
    ],
)
def test_simulate_refuses_unknown_words(arguments: tuple[str, ...], expected: str, tmp_path: Path) -> None:
    done = call("simulate", "spmsm_load_torque", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert expected in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_coarse_euler_is_cautioned(tmp_path: Path) -> None:
    (tmp_path / "coarse.toml").write_text(PAPER.replace("paper_spmsm", "coarse").replace("20e-6", "100e-6"))
    done = call("generate", "coarse.toml", cwd=tmp_path)
    assert done.returncode == 0
    assert "caution: drive 'coarse': forward Euler with T R / L = 0.34" in done.stderr
    assert "sample_time <= 5.81e-05 s" in done.stderr


def test_a_budget_exceeded_writes_nothing_and_exits_1(tmp_path: Path) -> None:
    text = PAPER.replace("paper_spmsm", "tight").replace("\ncycles = 3000 ", "\ncycles = 700 ")
    assert text.count("cycles = 700") == 1
    (tmp_path / "tight.toml").write_text(text)
    done = call("generate", "paper_spmsm", "tight.toml", "--out", "out", cwd=tmp_path)
    assert done.returncode == 1
    (line,) = done.stderr.strip().splitlines()
    assert re.search(r"drive 'tight': filter '\w+' takes \d+ cycles a step .*, budget.cycles is 700\. What would", line)
    assert not (tmp_path / "out").exists()
    (tmp_path / "tight.toml").write_text(text.replace("cycles = 700", "cycles = 20000"))
    assert call("generate", "tight.toml", "--out", "out", cwd=tmp_path).returncode == 0
    report = (tmp_path / "out" / "tight" / "REPORT.md").read_text()
    assert "The drive file allows: cycles = 20000" in report


@pytest.mark.thorough
def test_generate_and_check_need_no_cross_compiler(tmp_path: Path) -> None:
    """Without it the report says so, and neither machine calls the other's folder stale."""
    nothing = {"PATH": str(tmp_path / "empty")}
    assert call("generate", "paper_spmsm", "--check", cwd=tmp_path, **nothing).returncode == 0
    (tmp_path / "mine.toml").write_text(PAPER.replace("paper_spmsm", "mine"))
    done = call("generate", "mine.toml", "--out", "out", cwd=tmp_path, **nothing)
    assert done.returncode == 0, done.stderr
    report = (tmp_path / "out" / "mine" / "REPORT.md").read_text()
    assert "not measured: arm-none-eabi-gcc not found (Debian: gcc-arm-none-eabi)." in report
    for environment in (nothing, {}):
        done = call("generate", "mine.toml", "--out", "out", "--check", cwd=tmp_path, **environment)
        assert done.returncode == 0, done.stdout
