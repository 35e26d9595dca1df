"""Results that need not be made again: kept in the user's cache under a hash of everything they depend on.

Only what is good is kept, and what is shown says that it was. ``--fresh``, or the variable PMSM_ICKF_FRESH, has
everything made anew (and kept again).
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import pickle
import platform
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TypeVar

from runtime.estimator.compiler import cache_folder, drop_from_cache, find_compiler, in_cache, put_into_cache
from runtime.system.errors import UserError

Result = TypeVar("Result")

#: Set to anything, this variable has everything made anew.
FRESH = "PMSM_ICKF_FRESH"

#: The packages' own folders: whatever changes in them may change a result.
PACKAGES = ("model", "codegen", "runtime")
#: Libraries that compute.
LIBRARIES = ("numpy", "casadi", "sympy", "cffi", "pycparser", "jinja2")


def keep(
    what: str,
    folder: Path,
    facts: Iterable[str],
    make: Callable[[], Result],
    good: Callable[[Result], bool],
    fresh: bool,
) -> tuple[Result, bool]:
    """A result made now, or by an earlier run from the same sources; and whether it is an earlier run's.

    Parameters
    ----------
    what : str
        The kind of result: a word for the file's name.
    folder : Path
        The generated folder it is about, every file of which counts.
    facts : iterable of str
        What else it depends on: the drive file, options, tools.
    make : callable
    good : callable
        Whether a result may be kept; a failure never is.
    fresh : bool
        Make it now, whatever is kept.
    """
    of = f"{what}-{_digest(str(folder.resolve()))[:12]}"
    name = f"{of}-{_digest(repr((_texts(folder), sorted(facts), surroundings())))[:32]}.pickle"
    anew = fresh or bool(os.environ.get(FRESH))
    with _alone(of) if not anew else nullcontext():  # who comes second waits, and takes what the first has made
        path = None if anew else in_cache(name)
        if path is not None:
            result: Result = pickle.loads(path.read_bytes())
            return result, True
        result = make()
        drop_from_cache(f"{of}-*")  # what other sources made; and what was kept, should it no longer be so
        if good(result):
            put_into_cache(name, lambda scratch: _written(scratch / "result", pickle.dumps(result)))
    return result, False


@contextmanager
def _alone(name: str) -> Iterator[None]:
    """No other process is in this block with the same name; a killed one is out of it."""
    path = cache_folder() / f"{name}.lock"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("w", encoding="ascii")
    except OSError as error:
        raise UserError(f"cannot write to '{path.parent}': {error.strerror}. Set PMSM_ICKF_CACHE.") from None
    with file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


@cache
def surroundings() -> str:
    """Hash of the packages' sources, and of what executes them: interpreter, libraries, compiler, processor."""
    root = Path(__file__).parents[2]
    sources = [(package, _texts(root / package)) for package in PACKAGES]
    libraries = [f"{name} {_version(name)}" for name in LIBRARIES]
    machine = [
        sys.version,
        os.uname().sysname,
        os.uname().machine,
        *platform.libc_ver(),
        _processor(),
        *map(tool, find_compiler()),
    ]
    return _digest(repr((sources, libraries, machine)))


def tool(name: str) -> str:
    """A program as it is installed: its file, size and date; an upgrade is another one."""
    path = shutil.which(name)
    if path is None:
        return f"{name}: none"
    file = Path(path).resolve()
    stat = file.stat()
    return f"{file} {stat.st_size} {stat.st_mtime_ns}"


def _texts(folder: Path) -> list[tuple[str, str]]:
    """Every file below a folder, by path and hash."""
    try:
        files = sorted(path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
        return [(str(path.relative_to(folder)), hashlib.sha256(path.read_bytes()).hexdigest()) for path in files]
    except OSError as error:
        raise UserError(f"'{error.filename}' cannot be read: {error.strerror}.") from None


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "none"


def _processor() -> str:
    """The processor that -march=native stands for on this machine."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line for line in lines if line.startswith("flags")), "")
