"""The command ``export``: what it writes, and what it refuses in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from runtime.cli import main


def ended(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str]:
    """Exit code and what was said."""
    try:
        main(["export", *words])
        code = 0
    except SystemExit as end:
        code = int(end.code or 0)
    captured = capsys.readouterr()
    return code, captured.out + captured.err


@pytest.mark.parametrize("words", ["fmu", "fmu --part drive --fmi 3", "sfunction", "plecs --part motor", "a2l"])
def test_writes_one_file(words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "made_here.c"
    code, said = ended(capsys, *words.split(), "servo_24v", "--out", str(out))
    assert code == 0, said
    assert list(tmp_path.iterdir()) == [out]
    assert out.stat().st_size > 5000
    before = out.read_bytes()
    ended(capsys, *words.split(), "servo_24v", "--out", str(out))
    assert out.read_bytes() == before


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("fmu servo --out x", "Did you mean 'servo_24v'"),
        ("fmu servo_24v --filter ekf --out x", "has no filter 'ekf'"),
        ("sfunction servo_24v --out my-x.c", "name of an S-function"),
        ("a2l servo_24v --out x --symbol [x]", "'[x]' is not the name"),
        ("a2l servo_24v --out x --address 1e3", "'1e3' is not an address"),
    ],
)
def test_one_line_and_2(
    words: str, line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, said = ended(capsys, *words.split())
    assert code == 2
    assert line in said
    assert said.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
