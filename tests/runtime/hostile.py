"""The command line in this process, for inputs by the hundred: exit code and what was said."""

from __future__ import annotations

import io
from contextlib import redirect_stderr, redirect_stdout

from runtime.cli import main


def command(*arguments: str) -> tuple[int, str]:
    """Exit code and stderr of ``pmsm-ickf``; an exception that the user would see as a traceback comes through."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        try:
            main(list(arguments))
        except SystemExit as end:
            return int(end.code or 0), err.getvalue()
    return 0, err.getvalue()


def assert_refused(*arguments: str) -> str:
    """The command ends with exit code 2 and one readable line, which is returned."""
    code, said = command(*arguments)
    assert code == 2, (arguments, code, said)
    (line,) = said.splitlines()
    assert line.startswith("pmsm-ickf: ")
    assert line.isprintable()
    assert len(line) < 600, f"nobody reads {len(line)} letters: {line[:200]}"
    return line
