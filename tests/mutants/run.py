"""Runs mutants: a process each, so that none leaves a trace; groups share what their checks need."""

from __future__ import annotations

import importlib
import multiprocessing
import os
import pickle
import queue
import resource
import select
import signal
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import groupby
from typing import Any

from tests.mutants.checks import Bench, bits_of, copy, first_failure, forms_of, overlaid, rewritten, run_pytest, verdict
from tests.mutants.mutant import ROOT, Mutant, Outcome, StaleMutantError, mutated_source, overlay

#: Seconds of processor time after which a mutant is taken to hang, and of the clock, whatever else the machine does.
PROCESSOR, PATIENCE = 200, 1800.0

#: The packages the project stands on, imported once for all source mutants; of the project itself nothing may be.
LIBRARIES = (
    "casadi", "sympy", "numpy", "pydantic", "jinja2", "cffi", "pycparser", "pytest", "hypothesis", "scipy.integrate",
    "scipy.optimize", "scipy.stats", "mpmath", "matplotlib.pyplot", "rich.console", "rich.progress", "typer",
)  # fmt: skip

Verdict = tuple[str, str] | None
Judge = Callable[[Mutant], Verdict]


def judge_source(mutant: Mutant) -> Verdict:
    """A mutated module: nothing of the project is imported yet."""
    import sys

    name = overlay(mutant)
    bench = Bench()
    found = _first(mutant, bench)
    if name not in sys.modules:
        raise RuntimeError(f"{name} was never imported: the checks do not meet the mutant")
    return found


def judge_data(bench: Bench) -> Judge:
    """A drive that only the generator sees."""
    return lambda mutant: _first(mutant, bench.with_change(mutant.drive))


def _first(mutant: Mutant, bench: Bench) -> Verdict:
    for check in mutant.checks:
        found = first_failure(check, bench)
        if found:
            return found
    return None


class EmittedBench:
    """The shipped folder of a drive, and what NumPy makes of it."""

    def __init__(self, drive: str, kind: str) -> None:
        from codegen.generate import build_steps
        from runtime.estimator.folder import find_folder
        from runtime.proof.second import second_motor

        self.kind, self.truth = kind, Bench().truth(drive)
        self.folder = find_folder(drive, checked=False)
        self.motor, self.data = second_motor(self.truth), self.truth.model_dump()
        self.step = build_steps(self.truth, "literal")[1][kind]
        self.record = bits_of(self.folder, self.truth, kind, self.step)
        _ = self.record.entries

    def __call__(self, mutant: Mutant) -> Verdict:
        found = self.shortly(mutant)
        return found if found or mutant.checks[0].split()[0] == "foc" else self.in_full(mutant)

    def shortly(self, mutant: Mutant) -> Verdict:
        return self._failure(mutant, self.record)

    def in_full(self, mutant: Mutant) -> Verdict:
        """As much as verify compares."""
        full = bits_of(self.folder, self.truth, self.kind, self.step, steps=10_000, draws=2000)
        found = self._failure(mutant, full)
        return (f"{found[0]}, in full", found[1]) if found else None

    def _failure(self, mutant: Mutant, record: Any) -> Verdict:
        folder = overlaid(self.folder, mutant.file.split("/", 1)[1], mutant.text)
        links = getattr(self, mutant.checks[0].split()[0])(folder, record)
        return next((verdict(link) for link in links if not link.passed), None)

    @staticmethod
    def filter(folder: Any, record: Any) -> Any:
        """Link D-E on the mutated text, against what NumPy made of the shipped module."""
        mutated = copy(record)
        mutated.folder = folder
        return mutated

    def scalar(self, folder: Any, record: Any) -> Iterator[Any]:
        from runtime.proof.link_guard import link_data

        yield self.filter(folder, record).link(("-O0",))
        yield link_data(folder, self.kind, self.step.gain, self.data, self.motor)
        yield self.text(folder, self.kind)

    def text(self, folder: Any, kind: str) -> Any:
        from runtime.proof.link_text import link_text

        return link_text(folder, kind, self.step.gain)

    def lanes(self, folder: Any, record: Any) -> Iterator[Any]:
        import runtime.estimator.lanes as lanes

        lanes.OPTIMISATION = ("-O0",)
        yield self.filter(folder, record).lane_link()
        yield self.text(folder, self.kind)

    def foc(self, folder: Any, record: Any) -> Iterator[Any]:
        from runtime.proof.link_foc import _bits, link_control

        yield _bits(folder, self.kind, self.step.gain, self.data)
        yield from link_control(folder, self.kind, self.step.gain, self.data, self.motor)
        yield self.text(folder, self.kind)

    def module(self, folder: Any, record: Any) -> Iterator[Any]:
        """The mutated module's bits against the shipped C, for either filter; then the controller's."""
        from codegen.generate import build_steps

        steps, draws = len(record.u), record.singles[0].lanes
        steps_of = build_steps(self.truth, "literal")[1]
        for kind, step in steps_of.items():
            yield bits_of(folder, self.truth, kind, step, steps, draws).link(("-O0",))
        yield from self.foc(folder, record)
        for kind in steps_of:
            yield self.text(folder, kind)


class StepJudge:
    """Link text on a shipped folder in which one text of the step is another, in the forms that the text is part of."""

    def __init__(self, drive: str) -> None:
        from runtime.estimator.folder import find_folder

        self.folder = find_folder(drive, checked=False)

    def __call__(self, mutant: Mutant) -> Verdict:
        from runtime.proof.link_text import link_text

        file, kind = mutant.file.split("/", 1)[1], mutant.checks[0].split()[2]
        folder = overlaid(self.folder, file, mutant.text)
        links = (link_text(folder, kind, "as shipped", (form,)) for form in forms_of(file))
        return next((verdict(link) for link in links if not link.passed), None)


class TextJudge:
    """Tests on a shipped folder in which one file has another text."""

    def __call__(self, mutant: Mutant) -> Verdict:
        name, file = mutant.file.split("/", 1)
        for node in mutant.checks:
            with rewritten(name, file, mutant.text):
                found = run_pytest(node.removeprefix("pytest "))
            if found:
                return found
        return None

    def shortly(self, mutant: Mutant) -> Verdict:
        """In a process of its own: test modules must not be imported before the folder is exchanged."""
        found = in_child(self, mutant)
        if found.crash:
            raise RuntimeError(found.crash)
        return (found.killer, found.said) if found.killer else None


# --- processes


def in_child(judge: Judge, mutant: Mutant, patience: float = PATIENCE) -> Outcome:
    """Fork, judge there, and read what became of it."""
    start, (read, write) = time.monotonic(), os.pipe()
    child = os.fork()
    if child == 0:
        os.close(read)
        os.setpgid(0, 0)
        resource.setrlimit(resource.RLIMIT_CPU, (PROCESSOR, PROCESSOR))
        os.environ.setdefault("PMSM_ICKF_CACHE", os.path.join(tempfile.gettempdir(), f"pmsm-mutants-{os.getuid()}"))
        _speak(write, judge, mutant)
        os._exit(0)
    os.close(write)
    said = _listen(read, start + patience)
    if said is None:
        os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    os.close(read)
    killer, words, crash = said or ("", "", f"no answer within {PROCESSOR} s of work, or the process died")
    return Outcome(mutant, killer, words, crash, time.monotonic() - start)


def _speak(write: int, judge: Judge, mutant: Mutant) -> None:
    try:
        found = judge(mutant)
        answer = (*found, "") if found else ("", "", "")
    except BaseException as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        answer = (
            "",
            "",
            f"{type(error).__name__}: {str(error)[:300]} ({place.filename.rsplit('/', 1)[-1]}:{place.lineno})",
        )
    with os.fdopen(write, "wb") as pipe:
        pickle.dump(answer, pipe)


def _listen(read: int, until: float) -> tuple[str, str, str] | None:
    parts = []
    while True:
        ready, _, _ = select.select([read], [], [], max(0.0, until - time.monotonic()))
        if not ready:
            return None
        part = os.read(read, 65536)
        if not part:
            break
        parts.append(part)
    return pickle.loads(b"".join(parts)) if parts else None


def _prepare(group: str) -> Judge:
    word, *rest = group.split()
    if word == "source":
        for library in LIBRARIES:
            importlib.import_module(library)
        return judge_source
    if word == "unmutated":
        return lambda mutant: _first(mutant, Bench())
    if word == "data":
        return judge_data(Bench())
    if word == "text":
        return TextJudge()
    if word == "step":
        return StepJudge(rest[0])
    return EmittedBench(word, rest[0])


def _lead(group: str, members: list[int], mutants: list[Mutant], results: Any) -> None:
    """A group in a process of its own: prepare, then fork for each. Mutants travel by number: they hold functions."""
    judge = _prepare(group)
    for unmutated in _unmutated(judge, [mutants[number] for number in members]):
        # In this process: what is common to all mutants then fills the caches.
        _must_pass(getattr(judge, "shortly", judge), unmutated)
    in_full = []
    for number in members:
        found = in_child(judge, mutants[number])
        in_full += [mutants[number]] if found.killer.endswith("in full") else []
        results.put((number, found.killer, found.said, found.crash, found.seconds))
    for unmutated in _unmutated(judge, in_full):
        _must_pass(judge, unmutated)


def _must_pass(judge: Judge, unmutated: Mutant) -> None:
    found = judge(unmutated)
    assert not found, f"without a mutation '{unmutated.checks[0]}' is not passed: {found}"


def _unmutated(judge: Judge, mutants: list[Mutant]) -> Iterator[Mutant]:
    """The unchanged sources of a group's mutants pass each check once; source mutants have an own round before all."""
    one_each = {mutant.checks: mutant for mutant in mutants if not mutant.old and mutant.kind != "none"}
    for mutant in one_each.values():
        if isinstance(judge, EmittedBench | StepJudge):
            yield replace(mutant, text=judge.folder.text(mutant.file.split("/", 1)[1]))
        elif isinstance(judge, TextJudge):
            yield replace(mutant, text=(ROOT / "generated" / mutant.file).read_text(encoding="utf-8"))
        else:
            yield replace(mutant, drive=None)


def run(mutants: list[Mutant], jobs: int = 2) -> Iterator[Outcome]:
    """Outcomes as they come in. Stale mutants are an error before anything runs."""
    for mutant in mutants:
        if mutant.old:
            mutated_source(mutant)
    yield from (Outcome(mutant) for mutant in mutants if mutant.equivalent)
    context = multiprocessing.get_context("fork")
    results: Any = context.Queue()
    waiting = list(groups(mutants))
    left, running = sum(len(members) for _, members in waiting), []
    while left:
        running = [leader for leader in running if leader.is_alive()]
        while waiting and len(running) < jobs:
            name, members = waiting.pop(0)
            running.append(context.Process(target=_lead, args=(name, members, mutants, results)))
            running[-1].start()
        try:
            number, *rest = results.get(timeout=0.5)
        except queue.Empty:
            if not running and not waiting and results.empty():
                raise RuntimeError("a group ended without its outcomes; its last words are above") from None
            continue
        left -= 1
        yield Outcome(mutants[number], *rest)


def groups(mutants: list[Mutant], size: int = 12) -> Iterator[tuple[str, list[int]]]:
    """Numbers of the mutants that run together: of source mutants any, they share nothing."""
    alive = [number for number, mutant in enumerate(mutants) if not mutant.equivalent]

    def key(number: int) -> tuple[bool, str]:
        return bool(mutants[number].group), mutants[number].group or "source"

    for (_, name), members in groupby(sorted(alive, key=key), key=key):
        found = list(members)
        step = size if name in {"source", "unmutated"} else len(found)
        for k in range(0, len(found), step):
            yield name, found[k : k + step]


__all__ = ["StaleMutantError", "groups", "in_child", "run"]
