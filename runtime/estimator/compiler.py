"""Compile C into a shared library with the system's compiler, once for each content."""

from __future__ import annotations

import ctypes
import hashlib
import os
import re
import shlex
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from runtime.system.errors import UserError
from runtime.system.needs import packaged_compiler

#: Contraction into fused multiply-add would change bits, so it is always off.
FLAGS = ("-std=gnu99", "-ffp-contract=off")
LIBRARY = ("-fPIC", "-shared")
#: What ``zig cc`` would do otherwise: trap undefined behaviour. Its code is for the processor it runs on, as with
#: -march=native, unless it is told what every one of the kind can do.
PACKAGED = ("-fno-sanitize=undefined",)
ANY_PROCESSOR = "-mcpu=baseline"
#: GCC and clang may take half of an AVX-512 register unless they are told to take all of it; the bits are the same.
WIDE = "-mprefer-vector-width=512"

#: Seconds after which a compiler is taken to hang; each file needs a few.
PATIENCE = 300.0


#: What needs no compiler.
WITHOUT = 'Without one there are generate, replay --backend numpy, and load(..., backend="numpy").'


def find_compiler() -> list[str]:
    """A C compiler as a command: $CC if set, else cc, gcc or clang, else the one in the Python package ziglang.

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
        raise UserError(f"no C compiler: CC is set to '{wanted}', which is not a program. {WITHOUT}")
    for name in ("cc", "gcc", "clang"):
        if shutil.which(name):
            return [name]
    zig = packaged_compiler()
    if zig is not None:
        return [zig, "cc", *PACKAGED]
    raise UserError(
        "no C compiler found (looked for cc, gcc, clang, ziglang). Install one (Debian: apt-get install gcc; anywhere: "
        f"pip install 'pmsm-ickf[compiler]') or set CC. {WITHOUT}"
    )


def compiler_name() -> str:
    """The compiler's name for a table, without its folder."""
    return Path(find_compiler()[0]).name


def cache_folder() -> Path:
    """Where compiled libraries are kept: $PMSM_ICKF_CACHE, else the user's cache."""
    override = os.environ.get("PMSM_ICKF_CACHE")
    if override:
        return Path(override)
    base = os.environ.get("XDG_CACHE_HOME")
    try:
        return (Path(base) if base else Path.home() / ".cache") / "pmsm-ickf"
    except RuntimeError:
        raise UserError("no home folder to keep compiled filters in. Set HOME or PMSM_ICKF_CACHE.") from None


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
    """Compile a program of its own, as :func:`build_library` does a library.

    Parameters
    ----------
    sources : mapping of str to str
        File texts by name.
    defines : mapping of str to str
        Macros for the command line.
    optimisation : tuple of str
        Flags; the cache keeps each combination apart.

    Returns
    -------
    Path
        The program in the cache.
    """
    return _build(sources, defines, optimisation, ".bin")


def _build(sources: Mapping[str, str], defines: Mapping[str, str], more: tuple[str, ...], suffix: str) -> Path:
    flags = [*FLAGS, *more, *(f"-D{name}={value}" for name, value in sorted(defines.items()))]
    compiler = find_compiler()
    if compiler[1:] == ["cc", *PACKAGED] and "-march=native" not in flags:
        flags.append(ANY_PROCESSOR)
    key = hashlib.sha256(
        repr((sorted(sources.items()), flags, compiler, _identity(compiler), _processor(flags))).encode()
    )
    return cached(f"{key.hexdigest()[:32]}{suffix}", lambda folder: _compile(compiler, flags, sources, folder))


def cached(name: str, make: Callable[[Path], Path]) -> Path:
    """Return a file of the cache; where it is missing or damaged, make it.

    The file's hash lies beside it, so that what was cut off or overwritten is never loaded.

    Parameters
    ----------
    name : str
        The file's name in the cache; it holds a digest of what the file is made of.
    make : callable
        From a folder to the file made in it.

    Raises
    ------
    UserError
        If nothing can be written there.
    """
    return in_cache(name) or put_into_cache(name, make)


def in_cache(name: str) -> Path | None:
    """A file of the cache if it is there, and as it was put there.

    Parameters
    ----------
    name : str
        Its name in the cache folder.

    Returns
    -------
    Path or None
    """
    built = cache_folder() / name
    seal = _seal(built)
    try:
        whole = seal.is_file() and built.is_file() and seal.read_text("ascii", "replace") == _digest(built)
    except OSError:
        return None
    return built if whole else None


def put_into_cache(name: str, make: Callable[[Path], Path]) -> Path:
    """Have a file made and keep it.

    Parameters
    ----------
    name : str
        Its name in the cache folder.
    make : callable
        Given a scratch folder, writes the file there and returns its path.

    Returns
    -------
    Path
        The file in the cache.

    Raises
    ------
    UserError
        Nothing can be written there.
    """
    built = cache_folder() / name
    try:
        built.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=built.parent) as scratch:
            made = make(Path(scratch))
            sealed = Path(scratch) / "seal"
            sealed.write_text(_digest(made), encoding="ascii")
            os.replace(made, built)
            os.replace(sealed, _seal(built))
    except OSError as error:
        raise UserError(
            f"cannot write the compiled filter to '{built.parent}': {error.strerror}. Set PMSM_ICKF_CACHE."
        ) from None
    return built


def _seal(built: Path) -> Path:
    return built.with_name(f"{built.name}.sha256")


def drop_from_cache(pattern: str) -> None:
    """Remove files of the cache, by a pattern of their names.

    Parameters
    ----------
    pattern : str
        As :meth:`pathlib.Path.glob` reads it.
    """
    for path in cache_folder().glob(pattern):
        path.unlink(missing_ok=True)


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def open_library(ffi: Any, library: Path) -> Any:
    """Open a library, also behind a path beyond the locale's letters.

    Parameters
    ----------
    ffi : cffi.FFI
        With the declarations made.
    library : Path

    Raises
    ------
    UserError
        If the system will not load it.
    """
    try:
        return ffi.dlopen(ffi.cast("void *", ctypes.CDLL(str(library))._handle))
    except OSError as error:
        raise UserError(
            f"'{library}' cannot be loaded: {error}. If its file system is mounted noexec, set PMSM_ICKF_CACHE."
        ) from None


def _compile(compiler: list[str], flags: list[str], sources: Mapping[str, str], folder: Path) -> Path:
    for name, text in sources.items():
        (folder / name).write_text(text, encoding="utf-8")
    files = [name for name in sources if name.endswith(".c")]
    run_compiler([*compiler, *flags, *files, "-o", "out", "-lm"], folder, f"the C compiler '{' '.join(compiler)}'")
    return folder / "out"


#: By which a compiler says that its linker failed, which has said why.
LINKED = re.compile(r"ld returned \d+ exit status|linker command failed")


def run_compiler(command: Sequence[str], folder: Path, what: str) -> None:
    """Run a compiler in ``folder``, which makes the file behind ``-o``.

    Parameters
    ----------
    command : sequence of str
        The whole command line.
    folder : Path
        Where it runs.
    what : str
        Beginning of an error's line.

    Raises
    ------
    UserError
        It cannot be started, fails, crashes, hangs, or makes nothing.
    """
    files = ", ".join(word for word in command if word.endswith(".c"))
    try:
        # A group of its own: the driver's children end with it. What it leaves lying then goes with the folder.
        process = subprocess.Popen(
            command, cwd=folder, process_group=0, env={**os.environ, "TMPDIR": "."},
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        )  # fmt: skip
    except OSError as error:
        raise UserError(f"{what} cannot be started: {error.strerror}.") from None
    try:
        said = process.communicate(timeout=PATIENCE)[1].decode("utf-8", "replace")
    except subprocess.TimeoutExpired:
        raise UserError(f"{what} did not end within {PATIENCE:g} s on {files}.") from None
    finally:
        if process.returncode is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    if process.returncode < 0:
        raise UserError(f"{what} crashed on {files}: {signal.strsignal(-process.returncode)}.")
    if process.returncode > 0:
        lines = [line for line in said.splitlines() if line.strip()]
        lines = [line for line in lines if not LINKED.search(line)] or lines or ["it does not say why"]
        reason = next((line for line in lines if "error" in line or "overflow" in line), lines[0])
        raise UserError(f"{what} failed on {files}: {reason[:300]}")
    if not (folder / command[command.index("-o") + 1]).is_file():
        raise UserError(f"{what} ended well on {files} but made no program.")


def _identity(compiler: list[str]) -> str:
    """The compiler behind the name, so that an upgrade recompiles."""
    path = Path(shutil.which(compiler[0]) or compiler[0]).resolve()
    stat = path.stat()
    return f"{path} {stat.st_size} {stat.st_mtime_ns}"


def _processor(flags: list[str]) -> str:
    """-march=native code belongs to one kind of processor; a cache may travel."""
    return _instructions() if "-march=native" in flags else ""


def _instructions() -> str:
    """What Linux says of the processor's instructions; nothing elsewhere."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return ""
    return next((line for line in lines if line.startswith("flags")), "")


def wide_vectors() -> tuple[str, ...]:
    """The flag for whole AVX-512 registers; none where this processor does not have them.

    Returns
    -------
    tuple of str
        To go with ``-march=native``.
    """
    return (WIDE,) if "avx512f" in _instructions().split() else ()
