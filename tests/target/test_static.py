"""The static gates pass on what is shipped, and each catches what is planted into a copy of it."""

from __future__ import annotations

import re
import shutil
from functools import cache
from pathlib import Path

import pytest

from model.schema import Drive
from runtime.estimator.folder import GENERATED
from runtime.firmware.static import static_checks, tool
from runtime.firmware.static.bans import ban_checks
from runtime.firmware.static.check import Check
from runtime.firmware.static.compilers import compiler_checks
from runtime.firmware.static.misra import category, deviations, misra_checks, rules
from runtime.system.errors import UserError
from tests.codegen.strict import need
from tests.conftest import thoroughly

#: A helper that every generated filter has, whatever its form: plants go into its body.
HELPER = "static float32 larger(float32 a, float32 b)\n{\n"
FILTER = "paper_spmsm_ckf.c"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """One filter of the shipped folder, to plant into."""
    for name in (FILTER, FILTER.replace(".c", ".h"), "pmsm_port.h"):
        shutil.copy(GENERATED / "paper_spmsm" / name, tmp_path)
    return tmp_path


def plant(folder: Path, body: str = "", before: str = "") -> None:
    """Put lines at the head of the helper's body, or before the helper."""
    path = folder / FILTER
    text = path.read_text()
    assert text.count(HELPER) == 1
    path.write_text(text.replace(HELPER, before + HELPER + body))


def said(checks: list[Check], name: str) -> list[str]:
    """The message of a failed check; a passed one says nothing here."""
    return [line for check in checks if check.name == name and check.state == "failed" for line in check.detail]


def test_compilers_have_nothing_to_say(drive: Drive) -> None:
    need("gcc"), need("clang")
    checks = compiler_checks(GENERATED / drive.name)
    assert len(checks) == 3
    assert {check.state for check in checks} == {"passed"}, [check.detail for check in checks]


@cache
def shipped_bans(name: str) -> list[Check]:
    return ban_checks(GENERATED / name)


def test_nothing_banned_is_in_the_firmware(drive: Drive) -> None:
    need("gcc")
    assert said(shipped_bans(drive.name), "banned constructs") == []


def test_every_division_is_guarded(drive: Drive) -> None:
    need("gcc")
    (check,) = [c for c in shipped_bans(drive.name) if c.name == "divisions guarded"]
    assert check.state == "passed", check.detail
    assert int(check.figure.split()[2]) > 10, "of filters and controllers"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper_spmsm", *thoroughly("ipmsm_flux")])  # all of them: pmsm-ickf firmware
def test_misra_required_rules_are_kept(name: str) -> None:
    need("cppcheck")
    (check,) = misra_checks(GENERATED / name)
    assert check.state == "passed", check.detail
    assert check.figure.startswith("0 required")


PLANTS = [
    # what, body planted, text before the helper, the gates that must see it
    ("double constant", "    a = (float32)(a * 0.1);\n", "", {"warnings, GCC", "hidden double", "banned constructs"}),
    (
        "unsuffixed literal",
        "    const float32 half = 0.5;\n    b = half;\n",
        "",
        {"warnings, GCC", "banned constructs"},
    ),
    ("double", "    const double wide = (double)a;\n    b = (float32)wide;\n", "", {"banned constructs"}),
    ("64 bits", "    long long wide = 1;\n    b = (float32)wide;\n", "", {"warnings, GCC", "banned constructs"}),
    ("char", "    const char small = 1;\n    b = (float32)small;\n", "", {"banned constructs"}),
    ("sizeof", "    b = (float32)sizeof(a);\n", "", {"banned constructs"}),
    (
        "missing prototype",
        "    b = twice(a);\n",
        "float32 twice(float32 a)\n{\n    return a + a;\n}\n\n",
        {"warnings, GCC", "warnings, Clang"},
    ),
    ("implicit function", "    b = sinf(a);\n", "", {"warnings, GCC", "warnings, Clang", "banned constructs"}),
    ("unguarded division", "    b = a / b;\n", "", {"divisions guarded"}),
    ("goto", "    goto end;\nend:\n", "", {"banned constructs"}),
    ("recursion", "    b = larger(a, b);\n", "", {"banned constructs"}),
    ("global", "    b = kept;\n    kept = a;\n", "static float32 kept;\n", {"banned constructs"}),
    ("uninitialised", "    float32 never;\n    b = never;\n", "", {"warnings, GCC", "warnings, Clang"}),
    ("C99", "    b = a; // C++\n", "", {"warnings, GCC", "warnings, Clang"}),
]


@pytest.mark.parametrize(("body", "before", "gates"), [p[1:] for p in PLANTS], ids=[p[0] for p in PLANTS])
def test_a_plant_is_caught(folder: Path, body: str, before: str, gates: set[str]) -> None:
    need("gcc"), need("clang")
    lines = len((folder / FILTER).read_text().partition(HELPER)[0].splitlines())
    plant(folder, body, before)
    checks = [*compiler_checks(folder), *ban_checks(folder)]
    for gate in gates:
        places = [re.match(rf"{FILTER}:(\d+):", line) for line in said(checks, gate)]
        assert any(place and 0 < int(place[1]) - lines < 10 for place in places), (gate, said(checks, gate))


def test_the_planted_division_is_the_only_new_complaint(folder: Path) -> None:
    need("gcc")
    before = said(ban_checks(folder), "divisions guarded")
    plant(folder, "    b = a / b;\n")
    after = said(ban_checks(folder), "divisions guarded")
    assert len(after) == len(before) + 1
    assert [line for line in after if line.endswith("larger divides by b")]


@pytest.mark.parametrize(
    ("body", "rule"),
    [
        ("    int one = 1;\n    if (one) {\n        b = a;\n    }\n", "14.4 (required)"),
        ("    b = larger(a, b);\n", "17.2 (required)"),
        ("    goto end;\nend:\n", "15.1 (advisory)"),
    ],
)
def test_misra_violations_are_caught(folder: Path, body: str, rule: str) -> None:
    need("cppcheck")
    plant(folder, body)
    (check,) = misra_checks(folder)
    assert check.state == "failed"
    assert any(line.startswith(FILTER) and rule in line for line in check.detail), check.detail


def test_a_file_that_does_not_parse_is_no_pass(folder: Path) -> None:
    need("gcc"), need("clang"), need("cppcheck")
    plant(folder, "    b = (;\n")
    checks = [*compiler_checks(folder), *ban_checks(folder), *misra_checks(folder)]
    assert {check.state for check in checks} == {"failed"}


def test_an_error_directive_is_no_pass(folder: Path) -> None:
    """cppcheck stops at #error and would have nothing to say of the rest."""
    need("cppcheck")
    plant(folder, before='#ifdef __TMS320C28XX__\n#error "not this one"\n#endif\n')
    (check,) = misra_checks(folder)
    assert check.state == "failed"


def test_an_empty_folder_is_no_pass(tmp_path: Path) -> None:
    need("gcc"), need("clang"), need("cppcheck")
    checks = [*compiler_checks(tmp_path), *ban_checks(tmp_path), *misra_checks(tmp_path)]
    assert {check.state for check in checks} == {"failed"}


def test_a_missing_tool_is_said(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tool.shutil, "which", lambda name: None)
    checks = static_checks(folder)
    assert {check.state for check in checks} == {"not run"}
    assert {line for check in checks for line in check.detail} == {
        "apt install gcc",
        "apt install clang",
        "apt install cppcheck",
        "apt install frama-c-base",
    }


def test_a_tool_that_does_not_end_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """In one line, and no gate takes the silence for a pass."""
    monkeypatch.setattr("runtime.firmware.static.tool.PATIENCE", 0.1)
    with pytest.raises(UserError, match=r"^sleep did not end within 0.1 s\.$"):
        tool.run(["sleep", "60"])


def test_every_deviation_is_advisory_and_documented() -> None:
    page = (Path(__file__).parents[2] / "docs" / "misra.md").read_text(encoding="utf-8")
    for rule, reason in deviations().items():
        assert rules()[rule]["category"] == "advisory", "a required rule has no deviation"
        assert f"| {rule} | {rules()[rule]['about']} | {reason} |" in page
    assert page.count("\n| ") == len(deviations()) + 1, "no row without a deviation, beside the head"


def test_both_examples_are_read(tmp_path: Path) -> None:
    """The example is two programs in one file: what is wrong in the one that its default leaves out is told, too."""
    need("gcc"), need("clang")
    for path in (GENERATED / "paper_spmsm").glob("*.[ch]"):
        if not path.stem.endswith("_ckf"):
            shutil.copy(path, tmp_path)
    for name in ("paper_spmsm_ckf.h", "paper_spmsm_ckf.c"):
        shutil.copy(GENERATED / "paper_spmsm" / name, tmp_path)
    path = tmp_path / "example_isr.c"
    text = path.read_text()
    place = "static float32 v_acting[2];"
    assert text.count(place) == 1
    path.write_text(text.replace(place, f"{place} static int never_used;"))
    checks = compiler_checks(tmp_path)
    assert all(
        any("never_used" in line for line in said(checks, name)) for name in ("warnings, GCC", "warnings, Clang")
    )


def test_a_rule_that_the_table_does_not_know_is_taken_as_required() -> None:
    assert category("99.9") == "required"
    assert all(category(rule) == found["category"] for rule, found in rules().items())
