"""Link G and recordings: every word of an answer, the verdict, exit codes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import runtime.board.session
from runtime.board import pil as link_g
from runtime.board.board import Answer
from runtime.board.pil import PilResult, tick_facts
from runtime.board.record import Receiver, Recording
from runtime.board.tables import pil_tables, recording_table
from tests.judges.made import (
    command,
    pil_result,
    read_json,
    text_of,
)


@pytest.mark.parametrize(
    ("change", "passed", "code", "words"),
    [
        ({}, True, 0, "the board agrees bit for bit, 3 steps"),
        ({"tolerance": "certificate"}, True, 0, "agrees within the certificate"),
        ({"different": 1}, False, 1, "NOT proved"),
        (
            {"different": 1, "divergence": link_g.Divergence(2, "omega", 1.0, 2.0, "0x1", "0x2", "identical bits")},
            False,
            1,
            "differs",
        ),
        (
            {"divergence": link_g.Divergence(-1, "omega", 1.0, 2.0, "0x1", "0x2", "identical bits")},
            False,
            1,
            "first divergence after reset",
        ),
        ({"compared": 2, "lost": [1]}, False, 1, "1 steps were lost"),
        ({"compared": 2, "ended": "no answer:"}, False, 2, "2 of 3 steps were compared"),
        ({"compared": 2, "interrupted": True, "ended": "interrupted"}, False, 130, "interrupted after 2 steps"),
        ({"wanted": 0, "compared": 0}, False, 1, "NOT proved"),
    ],
)
def test_pils_verdict(
    change: dict[str, Any], passed: bool, code: int, words: str, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = pil_result(**change)
    assert result.passed is passed
    monkeypatch.setattr(runtime.board.session, "pil", lambda *rest: result)
    ended: list[int] = []
    monkeypatch.setattr("runtime.cli.end_interrupted", lambda: ended.append(130))
    found, said = command("pil", "--port", "x", "--json", "g.json")
    assert (ended or [found])[0] == code, said
    assert words in said
    facts = read_json("g.json")
    assert (facts["passed"], facts["link"], facts["compared"]) == (passed, "G", result.compared)


def test_an_interrupted_board_that_differed_is_a_failure(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    parted = link_g.Divergence(2, "omega", 1.0, 2.0, "0x1", "0x2", "identical bits")
    monkeypatch.setattr(runtime.board.session, "pil", lambda *rest: pil_result(interrupted=True, divergence=parted))
    assert command("pil", "--port", "x")[0] == 1


def test_ticks_by_hand() -> None:
    assert list(pil_result(ticks=[105, 115, 3]).net_ticks()) == [100, 110, 0]
    ticks = np.r_[np.arange(100, 200), 1000]
    facts = tick_facts(ticks, 1e6)
    assert (facts["min"], facts["median"], facts["max"]) == (100, 150.0, 1000)
    assert facts["seconds"] == {"min": 1e-4, "median": 1.5e-4, "max": 1e-3}
    assert sum(facts["histogram"]["counts"]) == 101
    assert facts["histogram"]["counts"][-1] == 1
    assert facts["histogram"]["edges"][0] == 100
    assert facts["histogram"]["edges"][-1] == 1000
    assert "seconds" not in tick_facts(ticks, None)
    assert tick_facts(np.array([], int), 1e6) == {}
    assert sum(tick_facts(np.full(9, 7), None)["histogram"]["counts"]) == 9


def test_the_tables_of_a_board() -> None:
    result = pil_result(
        compared=2,
        wanted=4,
        lost=[1, 2],
        different=1,
        tolerance="certificate",
        used=0.25,
        beyond=3,
        board_repeats=6,
        board_bad_frames=8,
    )
    result.counts.requests, result.counts.resent = 11, 12
    said = " ".join(text_of(pil_tables(result, 1e6)).split())
    for words in (
        "2 compared, 2 lost on the line, of 4; from equal starts, on its own bits",
        "within the certificate 1 of 2 steps",
        "0.25 of what it allows, at most; 3 steps beyond it",
        "11 requests, sent again 12 times",
        "answered 6 repeated requests without stepping again, dropped 8 damaged frames",
        "min 100, median 110, max 200",
        "min 100 us, median 110 us, max 200 us",
    ):
        assert words in said, said
    single = " ".join(text_of(pil_tables(pil_result(mode="single"), None)).split())
    assert "each from the board's state before it" in single
    assert "identical bits 3 of 3 steps" in single
    assert " us" not in single
    recording = Recording(rows=5, lost=3, gaps=2, damaged=4, left_out=6, restarts=1, first_gaps=[0.25, 0.5])
    recording.recent.append((1.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 9.0, 0.0))
    lines = " ".join(text_of(recording_table(recording)).split())
    for words in (
        "samples 5 over 1.5 s of the board's time",
        "lost on the line 3 frames in 2 gaps, the first at t = 0.25, 0.5 s",
        "damaged frames 4",
        "left out by the board 6 times",
        "restarts of the board 1",
        "latest u_alpha 1, u_beta 2, i_alpha 3, i_beta 4, omega_estimate 5, theta_estimate 6",
    ):
        assert words in lines, lines


def _judge(mode: str, tolerance: str = "bits") -> tuple[link_g._Judge, PilResult, Any]:
    from runtime.estimator.folder import find_folder

    folder = find_folder("paper_spmsm")
    result = pil_result(mode=mode, tolerance=tolerance, compared=0, ticks=[])
    return link_g._Judge(folder, "ickf", "numpy", result), result, folder


def _answered(words: Any, status: int = 0, iterations: int = 1) -> Answer:
    return Answer(status, iterations, 10, words)


def test_every_word_status_and_iteration_of_a_board_is_compared() -> None:
    judge_, result, _ = _judge("free")
    u, y = np.float32([1.0, 2.0]), np.float32([0.5, -0.5])
    words, status, iterations = judge_.expect(judge_.twin.words, u, y)
    assert judge_.bits(0, (words, status, iterations), _answered(words.copy(), status, iterations))
    assert result.divergence is None
    for k in range(len(words)):
        wrong = words.copy()
        wrong.view(np.uint32)[k] ^= 1
        result.divergence = None
        assert not judge_.bits(4, (words, status, iterations), _answered(wrong, status, iterations))
        assert result.divergence is not None
        assert (result.divergence.step, result.divergence.element) == (4, judge_.twin.word_names[k])
        assert result.divergence.expected == float(words[k])
        assert result.divergence.found == float(wrong[k])
        assert int(result.divergence.expected_bits, 16) ^ int(result.divergence.found_bits, 16) == 1
    first = result.divergence
    for bad in (_answered(words, status ^ 2, iterations), _answered(words, status, iterations + 1)):
        assert not judge_.bits(5, (words, status, iterations), bad)
        assert result.divergence is first, "the first one stays"
        result.divergence = None
        assert not judge_.bits(5, (words, status, iterations), bad)
        assert result.divergence.element == ("status" if bad.status != status else "iterations")
        first = result.divergence


def test_free_runs_on_and_single_starts_from_the_board() -> None:
    u, y = np.float32([1.0, 2.0]), np.float32([0.5, -0.5])
    free, _, _ = _judge("free")
    start = free.twin.words.copy()
    one = free.expect(start, u, y)[0].copy()
    two = free.expect(start, u, y)[0].copy()
    assert not np.array_equal(one, two)
    single, _, _ = _judge("single")
    assert np.array_equal(single.expect(start, u, y)[0], one)
    assert np.array_equal(single.expect(start, u, y)[0], one)


def test_the_certificate_allows_what_it_says_and_no_more() -> None:
    u, y = np.float32([1.0, 2.0]), np.float32([0.5, -0.5])
    judge_, result, folder = _judge("single", "certificate")
    certificate = folder.manifest["filters"]["ickf"]["certificate"]
    before = judge_.twin.words.copy()
    for _ in range(300):
        before = judge_.expect(before, u, y)[0].copy()
    expected = judge_.expect(before, u, y)
    words = expected[0].copy()
    shares = judge_._shares(words, judge_.twin.P, words, judge_.twin.P)
    assert len(shares) == 4 + 10
    assert not shares.any()
    for k in range(4):
        near, far = words.astype(float), words.astype(float)
        near[k] += 0.5 * certificate["x"][k]
        far[k] += 40 * certificate["x"][k] + 40 * np.spacing(np.float32(abs(words[k])))
        assert judge_._shares(words, judge_.twin.P, far, judge_.twin.P).max() > 6
        result.divergence = None
        assert not judge_.certified(
            0, before, (u, y), expected, _answered(far.astype(np.float32), expected[1], expected[2])
        )
        assert result.divergence is not None
        assert result.divergence.element == ("i_alpha", "i_beta", "omega", "theta")[k]
        assert f"{certificate['x'][k]:g}" in result.divergence.allowed
        assert judge_._shares(words, judge_.twin.P, near, judge_.twin.P).max() == pytest.approx(0.5, rel=1e-3)
    turned = words.astype(float)
    turned[3] += 2 * math.pi
    assert judge_._shares(words, judge_.twin.P, turned, judge_.twin.P).max() < 1e-3
    P = judge_.twin.P.astype(float)
    wider = P.copy()
    wider[2, 0] += 0.5 * certificate["P"] * math.sqrt(P[2, 2] * P[0, 0])
    assert judge_._shares(words, P, words, wider).max() == pytest.approx(0.5, rel=1e-3)
    missing = words.astype(float)
    missing[1] = np.nan
    assert judge_._shares(words, P, missing, P).max() == np.inf
    result.divergence = None
    assert not judge_.certified(0, before, (u, y), expected, _answered(words, expected[1] ^ 1, expected[2]))
    assert result.divergence is not None
    assert result.divergence.element == "status"
    assert judge_.certified(0, before, (u, y), expected, _answered(words, expected[1] ^ 2, expected[2]))
    assert result.used > 6


def test_settings_of_link_g() -> None:
    assert link_g.check_settings(None, "bits") == "free"
    assert link_g.check_settings(None, "certificate") == "single"
    assert link_g.check_settings("single", "bits") == "single"
    for mode, tolerance in (("free", "certificate"), ("x", "bits"), (None, "x")):
        with pytest.raises(link_g.UserError):
            link_g.check_settings(mode, tolerance)


@pytest.mark.parametrize("bad", [False, True])
def test_a_board_with_one_wrong_constant_ends_with_1(bad: bool, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The command itself with a simulated board, whose program counts every step's last word one bit too high."""
    import runtime.board.simulated as simulated

    original = simulated.board_sources

    def spoilt(folder: Any, kind: str) -> dict[str, str]:
        sources = original(folder, kind)
        name = f"{folder.drive}_{kind}.c"
        end = "    f->iterations = iterations;\n    return status;"
        assert sources[name].count(end) == 1
        sources[name] = sources[name].replace(end, "    f->x[2] *= 1.0000002f;\n" + end)
        return sources

    if bad:
        monkeypatch.setattr(simulated, "board_sources", spoilt)
    code, said = command("pil", "paper_spmsm", "--port", "simulated", "--steps", "30", "--json", "g.json")
    facts = read_json("g.json")
    assert (code, facts["passed"]) == (int(bad), not bad), said
    if bad:
        assert (facts["divergence"]["step"], facts["divergence"]["element"]) == (0, "omega") or facts["different"] > 0
        assert "the board differs" in said


def test_frames_become_rows_with_their_times() -> None:
    from runtime.board.frames import TELEMETRY, Frame

    receiver = Receiver()

    def row(sequence: int, sample: int) -> Any:
        import struct

        payload = struct.pack("<fI6f", 1e-4, sample, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
        return receiver._row(Frame(sequence, TELEMETRY, payload))

    assert row(7, 100) == (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 100.0, 0.0)
    assert row(8, 110)[0] == pytest.approx(10e-4)
    assert row(8, 110) is None
    found = row(11, 140)
    assert (found[0], found[-1]) == (pytest.approx(40e-4), 2.0)
    assert row(12, 160)[-1] == 0.0
    r = receiver.recording
    assert (r.lost, r.gaps, r.doubled, r.left_out, r.first_gaps) == (2, 1, 1, 1, [pytest.approx(40e-4)])
    assert row(13, 5)[0] == pytest.approx(61e-4)
    assert (r.restarts, r.lost, r.gaps) == (1, 3, 2)


@pytest.mark.parametrize(
    ("recording", "code", "words"),
    [
        (Recording(rows=5), 0, "Recorded: r.npz"),
        (Recording(rows=0), 2, "nothing was received"),
        (Recording(rows=4, ended="the line is dead: is the cable plugged in?"), 2, "4 samples are in 'r.npz'"),
    ],
)
def test_records_exit_codes(
    recording: Recording, code: int, words: str, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runtime.board.session, "record_data", lambda *rest: recording)
    ended, said = command("record", "--port", "x", "--out", "r.npz")
    Path("there.npz").touch()
    assert command("record", "--port", "x", "--out", "there.npz")[0] == 2
    assert ended == code, said
    assert words in said
