"""The fuzz target: kept inputs stay good, the judge sees what it is to see, and the campaign finds what is planted."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from runtime.endurance import fuzz as campaign
from runtime.endurance.inputs import choose, describe, read_kept, seeds, shorten, shortest, word_names, write_kept
from runtime.endurance.target import KINDS, Replayer, Target, targets
from runtime.estimator.compiler import build_library
from runtime.system.errors import UserError
from tests.conftest import EVERY_DRIVE
from tests.target.command import call

CORPUS = Path(__file__).with_name("corpus")


def replayer(target: Target, *changes: tuple[str, str]) -> Replayer:
    """The target with changes of its generated C; without optimisation, which compiles in half the time."""
    sources = dict(target.sources)
    for old, new in changes:
        assert old in sources[f"{target.core}.c"], old
        sources[f"{target.core}.c"] = sources[f"{target.core}.c"].replace(old, new)
    return Replayer(build_library(sources, target.defines, ("-O1",)))


@pytest.mark.parametrize("drive", EVERY_DRIVE)
def test_kept_inputs_stay_good(drive: str) -> None:
    for target in targets(drive):
        inputs, player = read_kept(CORPUS / f"{target.name}.bin"), replayer(target)
        assert len(inputs) > 20
        for data in inputs:
            verdict = player.play(data)[0]
            assert verdict.kind == 0, f"{target.name}: {KINDS[verdict.kind]}: {describe(data, target)}"


PAPER = next(target for target in targets("paper_spmsm") if target.name == "paper_spmsm_ickf")

#: The last line of a step before it returns.
END = "    f->iterations = iterations;\n"

#: The fault planted before a step returns, and the judge's verdict on kept inputs.
FAULTS = {
    "state not finite, unsaid": "f->x[2] = f->x[2] - 1e38f * f->x[2] * 1e38f;",
    "theta outside [-pi, pi), unsaid": "f->x[3] = (f->x[3] < 0.0f) ? f->x[3] : f->x[3] + 3.1415927f;",
    "covariance not finite, unsaid": "f->LD[8] = f->LD[8] / 0.0f;",
    "pivot negative, unsaid": "f->LD[2] = f->LD[2] - 0.5f;",
    "more iterations than asked for": "f->iterations = f->iterations + 13;",
}


@pytest.mark.parametrize(("what", "fault"), FAULTS.items(), ids=lambda text: text.split(" ")[0])
def test_the_judge_sees(what: str, fault: str) -> None:
    player = replayer(PAPER, (END, f"{END}    {fault}\n"))
    verdicts = {player.play(data)[0].kind for data in read_kept(CORPUS / f"{PAPER.name}.bin")}
    assert KINDS.index(what) in verdicts


def test_the_judge_sees_a_bad_duty_cycle() -> None:
    target = replace(PAPER, form="_foc")
    name, text = f"{target.name}.c", target.sources[f"{target.name}.c"]
    sources = {**target.sources, name: text.replace("    return status;", "    duty[1] += 1e-6f;\n    return status;")}
    player = Replayer(build_library(sources, target.defines, ("-O1",)))
    verdicts = {player.play(data)[0].kind for data in read_kept(CORPUS / f"{target.name}.bin")}
    assert KINDS.index("duty cycle outside [0, 1]") in verdicts


def test_bad_tuning_is_not_accepted_silently() -> None:
    """Infinity and NaN, written into Q or R of a filter that has run: a status bit says so."""
    player = replayer(PAPER)
    names = word_names(PAPER)
    for word in ("Q[0]", "R[1]"):
        for special in (30, 32):  # inf, NaN
            verdict = player.play(bytes([1, 4, names.index(word), special]))[0]
            assert verdict.kind == 0, (word, special)
            assert verdict.status != 0


def test_inputs_are_shortened_chosen_and_kept(tmp_path: Path) -> None:
    noisy = bytes(range(1, 40)) + bytes([4, 0, 34]) + bytes(range(60))
    assert shorten(noisy, lambda data: bytes([4, 0, 34]) in data)[1:] == bytes([4, 0, 34])
    chosen = choose(seeds(), replayer(PAPER), most=5)
    assert 0 < len(chosen) <= 5
    write_kept(tmp_path / "kept.bin", chosen)
    assert read_kept(tmp_path / "kept.bin") == chosen
    (tmp_path / "kept.bin").write_bytes((tmp_path / "kept.bin").read_bytes()[:-1])
    with pytest.raises(UserError, match="ends within an input"):
        read_kept(tmp_path / "kept.bin")


def test_an_input_is_put_into_words() -> None:
    data = bytes([1, 8 * 2, 4, 5, 32, 6, 4, 130, 5, 0, 31, 7, 1, 2 + 8 * 14, 33])
    assert describe(data, PAPER) == (
        "from a filter that has run; 3 ordinary steps; LD[1] = nan; LD[0] times 2^2; x[0] bit 31 flipped; reset; "
        "step(nan (signalling), ordinary, ordinary, ordinary)"
    )


@pytest.fixture
def fuzzer() -> None:
    try:
        campaign.find_fuzzer()
    except UserError as error:
        if os.environ.get("CI"):
            pytest.fail(str(error))
        pytest.skip(str(error))


@pytest.mark.thorough
@pytest.mark.usefixtures("fuzzer")
def test_a_campaign_finds_what_is_planted_and_nothing_like_it() -> None:
    broken = replace(PAPER)
    text = PAPER.sources["paper_spmsm_ickf.c"].replace(END, END + "    if (f->x[2] > 1e4f) { f->x[3] = 4.0f; }\n")
    broken.__dict__["sources"] = {**PAPER.sources, "paper_spmsm_ickf.c": text}
    good, bad = campaign.fuzz([(PAPER, 20_000), (broken, 100_000)])
    assert good.executions >= 20_000
    assert not any("theta outside" in finding.what or "error" in finding.what for finding in good.findings)
    assert any("theta outside" in finding.what for finding in bad.findings)


def test_a_finding_is_shortened() -> None:
    player = replayer(PAPER, (END, END + "    f->x[3] = f->x[3] + 4.0f;\n"))
    short, verdict = shortest(bytes([0, 24, 5, 3, 7, 16, 2, 9, 9, 9]), player)
    assert short == b"\0"
    assert KINDS[verdict.kind].startswith("theta outside")


@pytest.mark.thorough
def test_missing_tools_are_one_line(tmp_path: Path) -> None:
    (tmp_path / "python3").symlink_to(sys.executable)
    done = call("fuzz", "paper_spmsm", cwd=tmp_path, PATH=str(tmp_path))
    assert done.returncode == 2
    assert done.stderr == "pmsm-ickf: clang not found. Install it (Debian: apt-get install clang).\n"
    clang = tmp_path / "clang"
    clang.write_text('#!/bin/sh\n[ "$1" = -dumpversion ] && echo 14.0.6 || echo /nowhere\n')
    clang.chmod(0o755)
    done = call("fuzz", "paper_spmsm", cwd=tmp_path, PATH=str(tmp_path))
    assert done.returncode == 2
    assert "Debian: apt-get install libclang-rt-14-dev" in done.stderr
    assert len(done.stderr.splitlines()) == 1
