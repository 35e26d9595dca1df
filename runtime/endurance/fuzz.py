"""The campaign: libFuzzer with address and undefined-behaviour sanitizers on every generated filter and controller.

What is looked for: a crash, a sanitizer's report, and verdicts of the judge in fuzz_judge.h, which knows what a
step and its status promise. Divisions by zero are not among the reports: IEEE 754 defines them, and what comes of
them is judged as a state that is not finite.
"""

from __future__ import annotations

import hashlib
import os
import re
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path

from runtime.endurance.inputs import LONGEST, choose, describe, read_kept, seeds, shortest, write_kept
from runtime.endurance.target import KINDS, Replayer, Target
from runtime.estimator.compiler import FLAGS, cached, run_compiler
from runtime.estimator.threads import thread_count
from runtime.firmware.tools import MissingTool, find_tool
from runtime.system.errors import UserError
from runtime.system.files import make_folder
from runtime.system.programs import run_to_end

SANITIZERS = (
    "-fsanitize=fuzzer,address,undefined,float-cast-overflow",
    "-fno-sanitize-recover=all",
    # Comparisons of floats are not traced anyway, those of the player teach nothing: they cost half the time.
    "-fno-sanitize-coverage=trace-cmp,indirect-calls",
)
OPTIMISATION = ("-O2", "-g1")

#: Executions of one process; then another goes on with what it found, from another seed.
CHUNK = 500_000
#: Seconds after which one input counts as endless; ordinary ones take microseconds.
ENDLESS = 20

#: Called with target, executions more.
Progress = Callable[[str, int], None]


@dataclass(frozen=True)
class Finding:
    """A failure: the verdict in words (or a sanitizer's), the shortest input found, and it in words."""

    what: str
    data: bytes
    words: str


@dataclass
class Campaign:
    """One target's outcome: executions, seconds of one core, inputs kept, features they show."""

    target: str
    executions: int = 0
    seconds: float = 0.0
    kept: int = 0
    features: int = 0
    findings: list[Finding] = field(default_factory=list)

    @property
    def good(self) -> bool:
        """Whether something was executed and nothing found."""
        return self.executions > 0 and not self.findings


def find_fuzzer() -> str:
    """The path of clang, with the runtime libraries that ``-fsanitize=fuzzer,address`` links.

    Raises
    ------
    MissingTool
        If clang or a library is not installed.
    """
    clang = find_tool("clang")
    said = run_to_end([clang, "-dumpversion"]).out
    package = f"libclang-rt-{said.partition('.')[0] or '14'}-dev"
    folder = run_to_end([clang, "--print-runtime-dir"]).out.strip()
    for library in ("fuzzer", "asan"):
        if not folder or not any(Path(folder).glob(f"libclang_rt.{library}*.a")):
            raise MissingTool(f"clang's {library} runtime", package)
    return clang


def build_fuzzer(target: Target) -> Path:
    """The target under libFuzzer, compiled once for each content."""
    clang = find_fuzzer()
    defines = [f"-D{name}={value}" for name, value in {**target.defines, "FUZZER": "1"}.items()]
    flags = [*FLAGS, *OPTIMISATION, *SANITIZERS, *defines]
    key = hashlib.sha256(repr((sorted(target.sources.items()), flags, clang, os.stat(clang).st_mtime_ns)).encode())

    def make(folder: Path) -> Path:
        for name, text in target.sources.items():
            (folder / name).write_text(text, encoding="utf-8")
        files = [name for name in target.sources if name.endswith(".c")]
        run_compiler([clang, *flags, *files, "-o", "out"], folder, "clang")
        return folder / "out"

    return cached(f"{key.hexdigest()[:32]}.fuzzer", make)


class Searches:
    """Processes of libFuzzer that end together: all targets share the cores there are."""

    def __init__(self) -> None:
        self._running: set[subprocess.Popen[bytes]] = set()
        self._lock = threading.Lock()
        self._over = False

    def run(self, command: list[str]) -> tuple[int, str]:
        """Exit code and stderr; interrupted at once by :meth:`end`."""
        # The leak check needs rights to trace that containers do not give; nothing here allocates.
        environment = {**os.environ, "ASAN_OPTIONS": "detect_leaks=0:abort_on_error=0", "UBSAN_OPTIONS": ""}
        with self._lock:
            if self._over:
                return 0, ""
            process = subprocess.Popen(
                command, env=environment, process_group=0, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
            )  # fmt: skip
            self._running.add(process)
        try:
            said = process.communicate()[1].decode("utf-8", "replace")
        finally:
            with self._lock:
                self._running.discard(process)
        return (0 if self._over else process.returncode), said

    def end(self) -> None:
        """Stop all, those not yet started too."""
        with self._lock:
            self._over = True
            for process in self._running:
                os.killpg(process.pid, signal.SIGKILL)

    @property
    def over(self) -> bool:
        """Whether the searches were ended."""
        return self._over


def fuzz(
    tasks: Iterable[tuple[Target, int]], corpus: Path | None = None, progress: Progress = lambda name, more: None
) -> list[Campaign]:
    """Search every target, as many at once as there are cores.

    Parameters
    ----------
    tasks : iterable of (Target, int)
        What to search, and with how many executions.
    corpus : Path, optional
        A folder of kept inputs, ``<target>.bin``: searches begin with them, and leave there what shows every feature.

    Raises
    ------
    UserError
        Without clang, its libraries, or a compiler.
    """
    find_fuzzer()
    if corpus is not None:
        make_folder(corpus)
    searches = Searches()
    with ThreadPoolExecutor(min(thread_count(), os.cpu_count() or 1)) as pool:
        futures = [pool.submit(_search, target, executions, corpus, searches, progress) for target, executions in tasks]
        try:
            for future in as_completed(futures):
                future.result()
        except BaseException:
            searches.end()
            pool.shutdown(cancel_futures=True)
            raise
    return [future.result() for future in futures]


def _search(target: Target, executions: int, corpus: Path | None, searches: Searches, progress: Progress) -> Campaign:
    program, replayer = build_fuzzer(target), target.replayer()
    kept = corpus / f"{target.name}.bin" if corpus is not None else None
    result = Campaign(target.name)
    found: list[bytes] = []
    reports: list[tuple[str, bytes]] = []
    begun = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="pmsm-fuzz-") as scratch:
        grown = Path(scratch) / "corpus"
        grown.mkdir()
        for number, data in enumerate([*seeds(), *(read_kept(kept) if kept else [])]):
            (grown / f"seed{number}").write_bytes(data)
        while result.executions < executions and not reports and not searches.over:
            todo = min(CHUNK, executions - result.executions)
            code, said = searches.run(_command(program, grown, Path(scratch), todo, 1 + result.executions // CHUNK))
            done = re.search(r"number_of_executed_units: (\d+)", said)
            more = int(done[1]) if done else 0
            if not code and not more and not searches.over:
                raise UserError(f"libFuzzer made no execution of {target.name}: {said.strip()[-200:]}")
            result.executions += more
            found += [bytes.fromhex(text) for text in re.findall(r"^FINDING ([0-9a-f]*)$", said, re.MULTILINE)]
            if code:
                reports.append((_report(said), _artifact(Path(scratch))))
            progress(target.name, more)
        result.seconds = time.perf_counter() - begun
        inputs = choose([path.read_bytes() for path in sorted(grown.iterdir())], replayer)
    result.kept = len(inputs)
    result.features = len(frozenset().union(*(replayer.play(data)[1] for data in inputs)))
    result.findings = [Finding(text, data, describe(data, target)) for text, data in reports]
    result.findings += _shortened(found, target, replayer)
    if kept is not None and not searches.over:
        write_kept(kept, inputs)
    return result


def _shortened(found: list[bytes], target: Target, replayer: Replayer) -> list[Finding]:
    """One finding a kind of verdict and word, with the shortest input."""
    places: dict[tuple[int, int], bytes] = {}
    for data in sorted(found, key=len):
        verdict = replayer.play(data)[0]
        places.setdefault((verdict.kind, verdict.word), data)
    findings = []
    for _, data in sorted(places.items()):
        short, verdict = shortest(data, replayer)
        what = f"{KINDS[verdict.kind]}: word {verdict.word}, step {verdict.step}"
        findings.append(Finding(what, short, describe(short, target)))
    return findings


def _command(program: Path, grown: Path, scratch: Path, runs: int, seed: int) -> list[str]:
    flags: dict[str, object] = {
        "runs": runs,
        "seed": seed,
        "max_len": LONGEST,
        "len_control": 20,
        "timeout": ENDLESS,
        "reload": 0,
        "entropic": 0,
    }
    flags |= {"print_final_stats": 1, "artifact_prefix": f"{scratch}/", "verbosity": 1}
    return [str(program), *(f"-{name}={value}" for name, value in flags.items()), str(grown)]


def _report(said: str) -> str:
    """The line of a sanitizer or of libFuzzer that says what happened."""
    for line in said.splitlines():
        if "runtime error:" in line or "ERROR:" in line:
            return re.sub(r"^(==\d+== ?)?ERROR: ", "", line.strip())[:200]
    return "the process died: " + (said.strip().splitlines() or ["it says nothing"])[-1][:150]


def _artifact(scratch: Path) -> bytes:
    for path in sorted(scratch.glob("*-*")):
        if path.is_file() and path.name.split("-")[0] in ("crash", "timeout", "oom"):
            return path.read_bytes()
    return b""
