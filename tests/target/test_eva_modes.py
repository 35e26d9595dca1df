"""EVA's verdict on the supervisors: proved as they are shipped, and what is planted into one is seen."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from codegen.render.drive import default_kind
from runtime.estimator.folder import GENERATED
from runtime.firmware.static import tool
from runtime.firmware.static.eva_modes import MOST_OF_LENGTH, driver, mode_check, mode_checks, with_directions
from tests.codegen.strict import need
from tests.conftest import EVERY_DRIVE

NAME = "ipmsm_flux"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """What a supervisor is made of, of a drive whose guess is placed by sine and cosine."""
    made = tmp_path / NAME
    made.mkdir()
    for stem in (f"{NAME}_ckf", f"{NAME}_ckf_supervisor"):
        for end in (".h", ".c"):
            shutil.copy(GENERATED / NAME / f"{stem}{end}", made)
    for file in ("pmsm_port.h", "manifest.json"):
        shutil.copy(GENERATED / NAME / file, made)
    return made


def change(folder: Path, before: str, after: str) -> None:
    path = folder / f"{NAME}_ckf_supervisor.c"
    text = path.read_text()
    assert text.count(before) == 1, before
    path.write_text(text.replace(before, after))


@pytest.mark.parametrize("name", EVERY_DRIVE)
def test_no_run_time_error_in_an_interrupt_of_the_supervisor(name: str) -> None:
    """From any integers of 16 bits: no count overflows."""
    need("frama-c")
    kinds = json.loads((GENERATED / name / "manifest.json").read_text())["filters"]
    check = mode_check(GENERATED / name, default_kind(kinds))
    assert check.state == "passed", check.detail
    assert check.figure.startswith("0 alarms, ")
    reached, total = map(int, re.findall(r"(\d+) of (\d+) statements", check.figure)[0])
    assert reached >= total - 2


PLANTS = {
    "a count without its end": ("s->since += (s->since < MOST_SAMPLES) ? 1 : 0;", "s->since += 1;", "overflow"),
    "an end beyond 16 bits": ("#define MOST_SAMPLES 32000 ", "#define MOST_SAMPLES 40000L ", "overflow"),
    "a speed of no interval": ("/ larger(intervals, 1.0f)", "/ intervals", "div_float"),
    "a current of no size": ("larger(i_a * i_a + i_beta * i_beta, LEAST_SIZE)", "i_a * i_a + i_beta * i_beta", "float"),
    "outside": ("s->first[0] = s->reading[0];", "s->first[0] = s->reading[s->side];", "index"),
    "an angle that is none": ("wrap_angle(theta + TURN_PER_SAMPLE * omega)", "1e30f * omega * 1e30f", "mul_float"),
}


@pytest.mark.parametrize(("before", "after", "alarm"), PLANTS.values(), ids=PLANTS)
def test_what_is_planted_is_no_proof(folder: Path, before: str, after: str, alarm: str) -> None:
    need("frama-c")
    change(folder, before, after)
    check = mode_check(folder, "ckf")
    assert check.state == "not proved", check.figure
    assert any(alarm in line and "_supervisor.c" in line for line in check.detail[1:]), check.detail


@pytest.mark.parametrize("what", ["this is not C;", "for (;;) { }"])
def test_what_is_no_c_or_never_ends_fails(folder: Path, what: str) -> None:
    need("frama-c")
    change(folder, "    int taken = 0;\n", f"    int taken = 0;\n    {what}\n")
    assert mode_check(folder, "ckf").state == "failed"


# --- the box


@pytest.mark.parametrize("name", EVERY_DRIVE)
def test_every_word_of_the_supervisor_is_in_the_box(name: str) -> None:
    prefix = f"{name}_ckf"
    text, header = driver(GENERATED / name, prefix), (GENERATED / name / f"{prefix}_supervisor.h").read_text()
    struct = header[header.index("typedef struct") : header.index(f"}} {prefix}_supervisor_t;")]
    wanted = set(re.findall(r"^    int (\w+);", struct, re.M))
    arrays = re.findall(r"^    float32 (\w+)\[(\d+)\];", struct, re.M)
    wanted |= {f"{field}[{k}]" for field, size in arrays for k in range(int(size))}
    given = re.findall(r"^    s\.(\S+) = Frama_C", text, re.M)
    assert len(given) == len(set(given))
    assert {word for word in given if not word.startswith("rival.")} == wanted
    rival = {word.removeprefix("rival.") for word in given if word.startswith("rival.")}
    own = set(re.findall(r"^    f\.(\S+) = Frama_C", text, re.M))
    assert rival == (own if f"{prefix}_t rival;" in struct else set())
    assert {"x[3]", "u_held[0]"} <= own


def test_a_part_of_a_vector_is_no_longer_than_the_vector() -> None:
    """In float32, whatever the sizes, and with a root that is three units in the last place too small."""
    rng = np.random.default_rng(1)
    a, b = (np.float32(10.0 ** rng.uniform(-25, 6, 200_000) * rng.choice([-1, 1], 200_000)) for _ in range(2))
    b[::3] = 0
    a[::7] = b[::7]
    with np.errstate(under="ignore"):
        size = np.sqrt(np.maximum(a * a + b * b, np.float32(1e-12)))
    for _ in range(3):
        size = np.nextafter(size, np.float32(0))
    worst = float(np.max(np.maximum(np.abs(a / size), np.abs(b / size))))
    assert 1.0 <= worst < 1.0 + 1e-6 < MOST_OF_LENGTH


def test_the_fact_is_handed_over_where_it_is_true_alone() -> None:
    lines = "const float32 size = PMSM_SQRT(larger(a * a + b * b, LEAST_SIZE));\nconst float32 sine = b / size;\n"
    assert "b / size; /*@ assert range: -1.001 <= sine <= 1.001; */" in with_directions(lines)
    for before, after in (("a * a + b * b", "a * a + b * a"), ("b / size", "c / size"), ("larger(a", "smaller(a")):
        assert "assert" not in with_directions(lines.replace(before, after))


# --- what cannot be said


def test_a_machine_without_a_box_is_not_proved(folder: Path) -> None:
    path = folder / "manifest.json"
    facts = json.loads(path.read_text())
    facts["parameters"]["model"]["machine"] = "my_machine.py:Mine"
    path.write_text(json.dumps(facts))
    check = mode_check(folder, "ckf")
    assert (check.state, check.figure) == ("not proved", "no box")


def test_each_supervisor_has_a_row_and_a_folder_without_one_has_none(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    need("frama-c")
    rows = mode_checks(GENERATED / "paper_spmsm")
    assert [row.subject for row in rows] == ["paper_spmsm, ckf_supervisor", "paper_spmsm, ickf_supervisor"]
    path = folder / "manifest.json"
    facts = json.loads(path.read_text())
    facts["files"] = {name: value for name, value in facts["files"].items() if "supervisor" not in name}
    path.write_text(json.dumps(facts))
    assert mode_checks(folder) == []
    monkeypatch.setattr(tool.shutil, "which", lambda name: None)
    assert [row.state for row in mode_checks(GENERATED / "paper_spmsm")] == ["not run"]
