"""Compile C into a shared library with the system's compiler, once for each content."""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

from runtime.errors import UserError

#: Contraction into fused multiply-add would change bits, so it is always off.
FLAGS = ("-std=gnu99", "-ffp-contract=off")
LIBRARY = ("-fPIC", "-shared")


def find_compiler() -> list[str]:
    """The system's C compiler as a command: $CC if set, else cc, gcc or clang.

    Raises
    ------
    UserError
        If there is none.
    """
    wanted = os.environ.get("CC")
    if wanted is not None:
        command = shlex.split(wanted)
        if command and shutil.which(command[0]):
            return command
        raise UserError(
            f"no C compiler: CC is set to '{wanted}', which is not a program. The numpy back end works without one."
        )
    for name in ("cc", "gcc", "clang"):
        if shutil.which(name):
            return [name]
    raise UserError(
        "no C compiler found (looked for cc, gcc, clang). Install one (Debian: apt-get install gcc) or set CC; "
        'the numpy back end works without: backend="numpy".'
    )


def cache_folder() -> Path:
    """Where compiled libraries are kept: $PMSM_ICKF_CACHE, else the user's cache."""
    override = os.environ.get("PMSM_ICKF_CACHE")
    if override:
        return Path(override)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "pmsm-ickf"


def build_library(
    sources: Mapping[str, str], defines: Mapping[str, str], optimisation: tuple[str, ...] = ("-O2",)
) -> Path:
    """Compile ``sources`` (file name -> text) into one shared library, or find it in the cache.

    Parameters
    ----------
    sources : mapping
        ``.c`` files are compiled, the others may be included.
    defines : mapping
        Macros.
    optimisation : tuple of str
        Flags such as ``("-O3", "-march=native")``.

    Raises
    ------
    UserError
        No compiler, a failing compiler, or no place to write.
    """
    return _build(sources, defines, (*LIBRARY, *optimisation), ".so")


def build_program(
    sources: Mapping[str, str], defines: Mapping[str, str], optimisation: tuple[str, ...] = ("-O2",)
) -> Path:
    """:func:`build_library` for a program of its own."""
    return _build(sources, defines, optimisation, ".bin")


def _build(sources: Mapping[str, str], defines: Mapping[str, str], more: tuple[str, ...], suffix: str) -> Path:
    flags = [*FLAGS, *more, *(f"-D{name}={value}" for name, value in sorted(defines.items()))]
    compiler = find_compiler()
    key = hashlib.sha256(
        repr((sorted(sources.items()), flags, compiler, _identity(compiler), _processor(flags))).encode()
    )
    built = cache_folder() / f"{key.hexdigest()[:32]}{suffix}"
    if built.is_file():
        return built
    try:
        built.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=built.parent) as scratch:
            os.replace(_compile(compiler, flags, sources, Path(scratch)), built)
    except OSError as error:
        raise UserError(
            f"cannot write the compiled filter to '{built.parent}': {error.strerror}. Set PMSM_ICKF_CACHE."
        ) from None
    return built


def _compile(compiler: list[str], flags: list[str], sources: Mapping[str, str], folder: Path) -> Path:
    for name, text in sources.items():
        (folder / name).write_text(text, encoding="utf-8")
    files = [name for name in sources if name.endswith(".c")]
    done = subprocess.run(
        [*compiler, *flags, *files, "-o", "out", "-lm"], cwd=folder, capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        reason = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr.strip()[:200])
        raise UserError(f"the C compiler '{' '.join(compiler)}' failed on {', '.join(files)}: {reason}")
    return folder / "out"


def _identity(compiler: list[str]) -> str:
    """The compiler behind the name, so that an upgrade recompiles."""
    path = Path(shutil.which(compiler[0]) or compiler[0]).resolve()
    stat = path.stat()
    return f"{path} {stat.st_size} {stat.st_mtime_ns}"


def _processor(flags: list[str]) -> str:
    """-march=native code belongs to one kind of processor; a cache may travel."""
    if "-march=native" not in flags:
        return ""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return ""
    return next((line for line in lines if line.startswith("flags")), "")
