"""Starts the command line over and over without loading it each time: one process loads it, each call is a fork of it.

A call has its own process, working directory, environment, streams and exit code, as a shell would give it, and knows
nothing of an earlier one. What is about the start itself (loading, signals) starts an interpreter: see
:mod:`tests.runtime.processes`.

Run as a program, this is the process that loads: a request a line on its input, an exit code a line on its output.
"""

from __future__ import annotations

import atexit
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

ROOT = Path(__file__).parents[1]


def call(
    *arguments: str, cwd: Path, environment: Mapping[str, str] | None = None, answers: str = ""
) -> subprocess.CompletedProcess[str]:
    """Run ``pmsm-ickf`` with some arguments.

    Parameters
    ----------
    environment : mapping of str to str, optional
        Variables that differ from this process's.
    answers : str, optional
        What its standard input holds.
    """
    with ExitStack() as stack:
        told, out, err = (stack.enter_context(tempfile.TemporaryFile("w+", encoding="utf-8")) for _ in range(3))
        told.write(answers)
        told.flush()
        request = {
            "arguments": arguments,
            "cwd": str(cwd),
            "environment": {**os.environ, "PYTHONPATH": str(ROOT), **(environment or {})},
            "streams": [f"/proc/{os.getpid()}/fd/{stream.fileno()}" for stream in (told, out, err)],
        }
        code = _ask(request)
        texts = [_read(stream) for stream in (out, err)]
    return subprocess.CompletedProcess(arguments, code, *texts)


def _read(stream: IO[str]) -> str:
    stream.seek(0)
    return stream.read()


def _ask(request: dict[str, Any]) -> int:
    process = _loaded()
    assert process.stdin is not None
    assert process.stdout is not None
    print(json.dumps(request), file=process.stdin, flush=True)
    return int(process.stdout.readline())


_process: subprocess.Popen[str] | None = None


def _loaded() -> subprocess.Popen[str]:
    """The process that has loaded; anew where a test of interrupts has ended it, with all that its own started."""
    global _process
    if _process is not None and _process.poll() is None:
        return _process
    _process = subprocess.Popen(
        [sys.executable, "-m", "tests.forked"], cwd=ROOT, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "200"}, process_group=0,
    )  # fmt: skip
    atexit.register(_process.kill)
    return _process


def _serve() -> None:
    import runtime.__main__
    import runtime.cli
    from codegen.generate import generate
    from model.drives.load import load_drive

    for word in (word for words in runtime.cli.GROUPS.values() for word in words):
        runtime.cli.load_command(word)
    generate(load_drive("paper_spmsm"), samples=5)  # templates compiled, the sine's polynomial certified: once

    for line in sys.stdin:
        request = json.loads(line)
        child = os.fork()
        if not child:
            _become(request)
            runtime.__main__.main()
            sys.exit(0)
        _, status = os.waitpid(child, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)


def _become(request: dict[str, Any]) -> None:
    """This process is the command now."""
    os.setpgid(0, 0)
    for number, path in enumerate(request["streams"]):
        stream = os.open(path, os.O_WRONLY if number else os.O_RDONLY)
        os.dup2(stream, number)
        os.close(stream)
    os.environ.clear()
    os.environ.update(request["environment"])
    os.chdir(request["cwd"])
    sys.argv[1:] = request["arguments"]


if __name__ == "__main__":
    _serve()
