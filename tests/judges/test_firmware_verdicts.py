"""The verdicts on the generated C away from the host: states, figures, exit codes."""

from __future__ import annotations

import shutil
import zlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import runtime.firmware.gates
import runtime.firmware.link_ef as link_ef
from model.drives.load import load_drive
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.firmware.emulator import Outcome, dumped_words, outcome
from runtime.firmware.gates import Gated, run_gates
from runtime.firmware.link_ef import Comparison, Divergence
from runtime.firmware.static.bans import ban_checks
from runtime.firmware.tables import checks_table, remarks
from tests.judges.made import cells_of, check, command, read_json

# --- the command


def _gated(*states: str) -> Gated:
    return Gated("d", tuple(check(state) for state in states))


@pytest.mark.parametrize(
    ("states", "strict", "lenient"),
    [
        (("passed", "passed"), True, True),
        (("failed", "passed"), False, False),
        (("passed", "failed"), False, False),
        (("passed", "not run"), False, True),
        (("not run", "failed"), False, False),
        (("passed", "not proved"), True, True),
        ((), False, False),
    ],
)
def test_what_is_good(states: tuple[str, ...], strict: bool, lenient: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    assert (_gated(*states).good(False), _gated(*states).good(True)) == (strict, lenient)
    assert _gated(*states).failed is ("failed" in states)
    assert _gated(*states).missing is ("not run" in states)
    monkeypatch.setattr(runtime.firmware.gates, "check_firmware", lambda *rest, **keys: [_gated(*states)])
    assert command("firmware")[0] == (not strict)
    assert command("firmware", "--allow-missing")[0] == (not lenient)


@pytest.mark.parametrize(("cpus", "shared"), [(None, 0), (1, 0), (2, 2), (8, 3)])
def test_drives_are_shared_among_as_many_processes(
    cpus: int | None, shared: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    gates, asked = runtime.firmware.gates, []
    names = ["paper_spmsm", "ipmsm", "ipmsm_flux"]
    monkeypatch.setattr(gates.os, "cpu_count", lambda: cpus)
    monkeypatch.setattr(gates, "check_ready", lambda name: None)
    monkeypatch.setattr(gates, "check_or_recall", lambda name, fresh, progress: Gated(name, (check(),)))
    monkeypatch.setattr(gates, "share", lambda count, work, given, progress: asked.append((count, list(given))) or [])
    found = gates.check_firmware(names)
    assert (asked, [one.drive for one in found]) == (([(shared, names)], []) if shared else ([], names))


@pytest.mark.parametrize("bad", [0, 1, 2])
def test_one_drive_of_three_fails_all(bad: int, monkeypatch: pytest.MonkeyPatch) -> None:
    found = [_gated("failed" if k == bad else "passed") for k in range(3)]
    monkeypatch.setattr(runtime.firmware.gates, "check_firmware", lambda *rest, **keys: found)
    assert command("firmware")[0] == 1


def test_every_gate_is_asked_and_a_planted_double_ends_with_1(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The command itself on a folder in which one function computes in double; of the gates the one that reads C."""
    gates = runtime.firmware.gates
    assert [gate.__name__ for gate in gates.GATES] == ["link_ef", "static_gate"]
    folder = here / "paper_spmsm"
    folder.mkdir()
    for name in ("paper_spmsm_ckf.c", "paper_spmsm_ckf.h", "pmsm_port.h", "manifest.json"):
        shutil.copy(GENERATED / "paper_spmsm" / name, folder)
    monkeypatch.setattr(gates, "GATES", (lambda f, progress: [check()], lambda f, progress: ban_checks(f.path)))
    monkeypatch.setattr(gates, "find_drive", lambda name: SimpleNamespace(path=folder, drive=load_drive("paper_spmsm")))
    monkeypatch.setattr(gates, "check_ready", lambda name: None)
    monkeypatch.setattr(gates, "current_package", lambda *rest: None)
    for planted in (False, True):
        if planted:
            path = folder / "paper_spmsm_ckf.c"
            text = path.read_text()
            head = "static float32 larger(float32 a, float32 b)\n{\n"
            assert text.count(head) == 1
            path.write_text(text.replace(head, head + "    double c = (double)a;\n    b = (float32)c;\n"))
        code, said = command("firmware", "paper_spmsm", "--json", "f.json")
        facts = read_json("f.json")
        assert (code, facts["passed"]) == (int(planted), not planted), said
        states = [entry["state"] for entry in facts["drives"][0]["checks"]]
        assert states == ["passed", "failed" if planted else "passed", "passed"]
        assert ("type double" in said) is planted


def test_checks_of_all_gates_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [check(name="first"), check("failed", name="second"), check(name="third")]
    monkeypatch.setattr(
        runtime.firmware.gates, "GATES", (lambda f, p: rows[:1], lambda f, p: [], lambda f, p: rows[1:])
    )
    found = run_gates(GeneratedFolder(GENERATED / "paper_spmsm"), lambda text: None)
    assert (found.drive, [one.name for one in found.checks]) == ("paper_spmsm", ["first", "second", "third"])
    assert found.failed


def test_the_table_of_checks() -> None:
    checks = [
        check(figure="7 found", detail=("why",)),
        check("failed", detail=("why not",)),
        check("not run"),
        check("not proved"),
    ]
    cells = cells_of(checks_table(checks))
    assert cells[0] == ["a gate", "a subject", "7 found", "measured", "passed"]
    assert [one[-1] for one in cells] == ["passed", "failed", "not run", "not proved"]
    styles = [str(cell.style) for cell in checks_table(checks).columns[-1].cells]  # type: ignore[union-attr]
    assert styles == ["green", "bold red", "yellow", "yellow"]
    assert remarks(checks) == [("why", "dim"), ("why not", "bold red")]


# --- link E-F


def _comparison(divergence: Divergence | None = None, known: float = 1000.0, resolution: float = 0.0) -> Comparison:
    subject: Any = SimpleNamespace(
        name="d_ickf", words=("x[0]", "x[1]", "status"), integers=(False, False, True), part=""
    )
    processor: Any = SimpleNamespace(name="a chip", unit="cycles", known_loop=1000.0, resolution=resolution)
    found = Outcome(np.zeros(4, np.uint32), np.array([100.0, 120.0, 130.0, 1000.0]), known)
    return Comparison(subject, processor, 4, divergence, found)


def test_a_comparison_says_bits_median_and_worst() -> None:
    passed = _comparison().check(0)
    assert (passed.state, passed.name, passed.subject, passed.how) == (
        "passed",
        "E-F, a chip",
        "d_ickf",
        "measured on a stand-in",
    )
    assert passed.figure == "4 steps x 3 words identical; 125 cycles (worst 1,000)"
    assert passed.detail == ()
    assert _comparison().check(2).detail[0].startswith("2 words are NaN on both")
    failed = _comparison(Divergence(7, "x[1]", "1", "2")).check(0)
    assert (failed.state, failed.figure) == ("failed", "differs at step 7")
    assert failed.detail == (
        "d_ickf on a chip, link E-F: first divergence at step 7, x[1]: host 1, found 2, allowed identical bits",
    )


@pytest.mark.parametrize(
    ("counted", "resolution", "good"),
    [
        (1000.0, 0.0, True),
        (1001.0, 0.0, False),
        (999.0, 0.0, False),
        (1256.0, 256.0, True),
        (744.0, 256.0, True),
        (1257.0, 256.0, False),
        (743.0, 256.0, False),
    ],
)
def test_a_counter_is_believed_where_it_counts_a_known_loop(counted: float, resolution: float, good: bool) -> None:
    one, other = _comparison(known=counted, resolution=resolution), _comparison(resolution=resolution)
    assert one.counted_exactly is good
    for several in ([one], [one, other], [other, one]):
        found = link_ef._counter(one.processor, several, "d")
        assert found.state == ("passed" if good else "failed")
    assert f"loop of 1,000 cycles: counted {counted:,.0f}" in link_ef._counter(one.processor, [one], "d").figure
    assert ("in steps of 256" in found.figure) is bool(resolution)
    assert link_ef._counter(one.processor, [], "d").state == "failed"


def test_the_first_word_that_differs_is_told() -> None:
    expected = np.arange(6, dtype=np.uint32).reshape(2, 3) + np.uint32(0x3F800000)
    found = expected.copy()
    found[1, 1] += 1
    found[1, 2] += 1
    one = _comparison()

    def crc(words: Any) -> Any:
        return np.array([zlib.crc32(words_.astype("<u4").tobytes()) for words_ in words], np.uint32)

    processor: Any = SimpleNamespace(
        name="a chip", unit="cycles", known_loop=1000.0, resolution=0.0,
        run=lambda *rest: Outcome(crc(found), np.ones(2), 1000.0),
        words_at=lambda step, *rest: found[step],
    )  # fmt: skip
    recording: Any = SimpleNamespace(steps=2)
    result = link_ef.compare(processor, one.subject, recording, expected)
    assert result.divergence is not None
    assert (result.divergence.step, result.divergence.word) == (1, "x[1]")
    assert result.divergence.expected.endswith("(0x3f800004)")
    assert result.divergence.found.endswith("(0x3f800005)")
    assert float(result.divergence.expected.split()[0]) == pytest.approx(1 + 4 * 2**-23)
    assert result.check(0).state == "failed"
    found[:] = expected
    assert link_ef.compare(processor, one.subject, recording, expected).divergence is None
    found[0, 2] = 0xFFFFFFFF
    again = link_ef.compare(processor, one.subject, recording, expected).divergence
    assert again is not None
    assert (again.step, again.word, again.found) == (0, "status", "-1")
    found[1, 0] += 1
    assert link_ef.compare(processor, one.subject, recording, expected).divergence == again, "the first of two"


def test_every_subject_on_every_processor_and_one_that_does_not_end(monkeypatch: pytest.MonkeyPatch) -> None:
    one = _comparison()
    names = ["a", "b"]
    several: Any = [SimpleNamespace(**{**vars(one.subject), "name": name}) for name in names]
    words = np.array([[1, 2, link_ef.NAN]], np.uint32)
    monkeypatch.setattr(link_ef, "subjects", lambda folder: several)
    monkeypatch.setattr(link_ef, "RECORDINGS", {"": lambda folder, steps: SimpleNamespace(steps=1)})
    monkeypatch.setattr(link_ef, "run_on_host", lambda subject, recording: words)
    monkeypatch.setattr(link_ef, "missing_packages", lambda programs: ["a-package"] if programs == ("absent",) else [])

    def run(subject: Any, recording: Any, flags: Any) -> Outcome:
        if subject.name == "b":
            raise link_ef.UserError("it hangs")
        return Outcome(np.array([zlib.crc32(words.astype("<u4").tobytes())], np.uint32), np.ones(1), 1000.0)

    here: Any = SimpleNamespace(**{**vars(one.processor), "programs": (), "run": run})
    absent: Any = SimpleNamespace(name="none", programs=("absent",))
    folder: Any = SimpleNamespace(drive="d")
    asked = {"constant": False}
    monkeypatch.setattr(link_ef, "stated_drive", lambda folder: SimpleNamespace(constant_time=asked["constant"]))
    rows = link_ef.link_ef(folder, processors=(absent, here))
    states = [(row.name, row.subject, row.state) for row in rows]
    assert states == [
        ("E-F, none", "all", "not run"),
        ("E-F, a chip", "a", "passed"),
        ("E-F, a chip", "b", "failed"),
        ("counter, a chip", "d", "passed"),
    ]
    assert rows[1].detail[0].startswith("1 words are NaN")
    assert rows[2].detail == ("it hangs",)
    assert "apt-get install a-package" in rows[0].detail[0]
    assert [row.state for row in link_ef.link_ef(folder, processors=(absent,))] == ["not run"]
    asked["constant"] = True  # the one that ended is judged; its only step reported something
    judged = [row for row in link_ef.link_ef(folder, processors=(here,)) if row.name.startswith("constant time")]
    assert [(row.subject, row.state, row.figure) for row in judged] == [("a", "failed", "0 steps of status 0")]
    several[0].part = "foc"
    monkeypatch.setattr(
        link_ef, "RECORDINGS", dict.fromkeys(("", "foc"), lambda folder, steps: SimpleNamespace(steps=1))
    )
    assert not [row for row in link_ef.link_ef(folder, processors=(here,)) if row.name.startswith("constant time")]
    several[0].part, here.resolution = "", 256.0
    assert not [row for row in link_ef.link_ef(folder, processors=(here,)) if row.name.startswith("constant time")]


@pytest.mark.parametrize(
    ("status", "state", "figure"),
    [
        ((0, 1, 1, 1), "passed", "1 steps of status 0, 100 cycles each"),
        ((0, 0, 1, 1), "failed", "2 steps of status 0, 100 to 120 cycles each"),
        ((1, 0, 0, 0), "failed", "3 steps of status 0, 120 to 1,000 cycles each"),
        ((1, 2, 8, 16), "failed", "0 steps of status 0"),
    ],
)
def test_steps_of_status_0_must_take_as_long_as_each_other(status: tuple[int, ...], state: str, figure: str) -> None:
    found = link_ef.same_path(_comparison(), np.array(status, np.uint32))
    assert (found.name, found.subject, found.state) == ("constant time, a chip", "d_ickf", state)
    assert (found.figure, found.how) == (figure, "measured on a stand-in")


def test_lines_of_a_run() -> None:
    text = "E 0000000a\nL 00000064\nS 0000abcd 0000000c\nS ffffffff 0000001a\n"
    found = outcome(text, 2, "it", 4.0)
    assert [int(value) for value in found.checksums] == [0xABCD, 0xFFFFFFFF]
    assert list(found.cost) == [(12 - 10) * 4.0, (26 - 10) * 4.0]
    assert found.known_loop == 400.0
    for broken in (
        text.replace("E ", "F "),
        text.replace("L ", "F "),
        text.replace("S f", "F f"),
        text + "S 00000000 00000000\n",
    ):
        with pytest.raises(link_ef.UserError):
            outcome(broken, 2, "it", 1.0)
    assert list(dumped_words("W 00000001\nW 0000000f\n", 2, "it")) == [1, 15]
    with pytest.raises(link_ef.UserError):
        dumped_words("W 00000001\n", 2, "it")


def test_units_of_the_stand_ins(monkeypatch: pytest.MonkeyPatch) -> None:
    """Independent of the emulators: SysTick at the board's clock, 1024 ns an instruction; the AVR's at clock / 256."""
    from runtime.firmware import avr, cortex_m

    text = "E 00000000\nL 0007d000\nS 00000000 00000064\n"
    recording: Any = SimpleNamespace(steps=1)
    subject: Any = SimpleNamespace(name="x")
    monkeypatch.setattr(cortex_m.CortexM, "_run", lambda *rest: text)
    monkeypatch.setattr(avr.Avr, "_run", lambda *rest: text)
    small, boards = avr.Avr(), cortex_m.boards()
    for name, clock in (("cortex_m4f", 25e6), ("cortex_m33f", 20e6), ("cortex_m7", 25e6)):
        found = boards[name].run(subject, recording)
        assert found.cost[0] == round(100 / clock / 1024e-9)
        assert found.known_loop == 512_000 / (clock * 1024e-9)
        assert (boards[name].known_loop, boards[name].unit) == (20_002, "instructions")
    assert small.run(subject, recording).cost[0] == 100 * 256
    assert (small.resolution, small.known_loop, small.unit) == (256, 64_000, "cycles")
