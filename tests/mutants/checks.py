"""The checks: short versions of verify's links, and tests.

A check is a word and what it is about: ``A-B paper_spmsm``. It yields links, cheap ones first; the first that does
not pass kills. ``pytest <node>`` runs a test in this process; ``regenerated <drive> <node>`` runs it on a folder the
(mutated) generator writes first; ``noticed`` is ``pytest`` that takes any exception in a test's call for a failure.
Nothing of the project is imported before a mutated module is in its place.
"""

from __future__ import annotations

import contextlib
import io
import os
import shlex
import tempfile
from collections.abc import Callable, Iterator
from copy import copy
from pathlib import Path
from typing import Any

from tests.mutants.fresh import Fresh
from tests.mutants.mutant import ROOT

#: Kinds beside those that are shipped.
PEERS = ("ekf", "ukf")
STEPS, DRAWS, GUARDED = 60, 20, 1
BIT_STEPS, BIT_DRAWS = 420, 200


class Bench:
    """Drives, their folders as the generator makes them, and the reference's runs, each made once."""

    def __init__(self, change: Callable[[Any], Any] | None = None) -> None:
        self.change = change or (lambda drive: drive)
        self.fresh_ones: dict[Any, Fresh] = {}
        self.runs: dict[Any, list[Any]] = {}

    def with_change(self, change: Callable[[Any], Any] | None) -> Bench:
        """The same reference, another generator's input."""
        other = Bench(change)
        other.runs = self.runs
        return other

    def truth(self, name: str, gain: str = "", kinds: tuple[str, ...] = ()) -> Any:
        from model.drives.load import load_drive

        drive = load_drive(name)
        keys = {"gain": gain or drive.filter.gain, "kinds": list(kinds or drive.filter.kinds)}
        return drive.model_copy(update={"filter": drive.filter.model_copy(update=keys)})

    def fresh(self, form: str, name: str, gain: str = "", kinds: tuple[str, ...] = ()) -> Fresh:
        key = form, name, gain, kinds
        if key not in self.fresh_ones:
            self.fresh_ones[key] = Fresh(self.change(self.truth(name, gain, kinds)), form)
        return self.fresh_ones[key]

    def situations(self, truth: Any, kind: str, step: Any) -> list[Any]:
        """The reference along a short trajectory, and from draws of the box."""
        import numpy as np

        from codegen.evidence.box import sample_box
        from model.machines.state_space import build
        from runtime.proof.link_ab import reference_run
        from runtime.proof.second import second_motor
        from runtime.proof.verify import _full

        key = truth.name, truth.filter.gain, kind
        if key not in self.runs:
            from runtime.proof.own_trajectory import trajectory_of

            motor, data = second_motor(truth), truth.model_dump()
            first = self._start(truth)[None], np.diag(truth.filter.initial_covariance)[None]
            short, box = trajectory_of(truth, steps=STEPS), sample_box(truth, build(truth), DRAWS)
            self.runs[key] = [
                reference_run("trajectory", data, step, first, short.u[:, None], short.y[:, None], motor),
                reference_run("operating box", data, step, (box.x.T, _full(box)), box.u.T[None], box.y.T[None], motor),
            ]
        return self.runs[key]

    @staticmethod
    def _start(truth: Any) -> Any:
        import numpy as np

        from model.machines.state_space import default_initial_state

        return np.array(default_initial_state(truth), dtype=float)


# --- links


def model(bench: Bench, name: str) -> Iterator[Any]:
    """CasADi's f, h, F, H against SymPy's derivation."""
    from runtime.proof.second import compare_statements

    yield compare_statements(bench.truth(name))


def literal(bench: Bench, name: str, *kinds: str) -> Iterator[Any]:
    """Links A-B and guard of the literal form, for both gains."""
    import numpy as np

    from runtime.proof.link_ab import free_run, link_ab, own_run

    for truth, gain in _gains(bench, name, kinds):
        fresh = bench.fresh("literal", name, gain, kinds)
        R = np.array(truth.filter.measurement_noise)
        for kind, step in _kinds(bench, truth, fresh):
            runs = bench.situations(truth, kind, step)
            for run in runs:
                yield link_ab(fresh.module, step, name, run, R)
            own = own_run(fresh.module, kind, (runs[0].x[0], runs[0].P[0]), runs[0].u, runs[0].y)
            yield free_run(step, name, runs[0], own, fresh.module.ANGLE)
            yield _guard(bench, truth, fresh, step, "literal")


def fast(bench: Bench, name: str, *kinds: str) -> Iterator[Any]:
    """Links B-C and guard of the fast form, for both gains."""
    from runtime.proof.link_bc import link_bc

    for truth, gain in _gains(bench, name, kinds):
        one, other = (bench.fresh(form, name, gain, kinds) for form in ("literal", "fast"))
        for kind, step in _kinds(bench, truth, one):
            for run in bench.situations(truth, kind, step):
                yield link_bc(one.module, other.module, step, name, run)
            yield _guard(bench, truth, other, other.steps[kind], "fast")


def _gains(bench: Bench, name: str, kinds: tuple[str, ...]) -> Iterator[tuple[Any, str]]:
    own = bench.truth(name).filter.gain
    for gain in (own, *({"cubature", "jacobian"} - {own} if "ickf" in (kinds or ("ickf",)) else ())):
        yield bench.truth(name, gain, kinds), gain


def _kinds(bench: Bench, truth: Any, fresh: Fresh) -> Iterator[tuple[str, Any]]:
    """All kinds with the gain that is shipped; with the other one those that it matters to."""
    for kind, step in fresh.steps.items():
        if kind == "ickf" or truth.filter.gain == bench.truth(truth.name).filter.gain:
            yield kind, step


def _guard(bench: Bench, truth: Any, fresh: Fresh, step: Any, form: str) -> Any:
    from codegen.evidence.box import sample_box
    from runtime.proof.link_guard import link_guard
    from runtime.proof.second import second_motor
    from runtime.proof.verify import _full

    box = sample_box(truth, fresh.model, GUARDED)
    draws = box.x.T, _full(box), box.u.T, box.y.T
    return link_guard(fresh.module, step, truth.name, form, truth.model_dump(), second_motor(truth), draws)


def data(bench: Bench, name: str) -> Iterator[Any]:
    """The data of module and C."""
    from runtime.proof.link_guard import link_data
    from runtime.proof.second import second_motor

    truth, fresh = bench.truth(name), bench.fresh("literal", name)
    for kind in fresh.steps:
        yield link_data(fresh, kind, truth.filter.gain, truth.model_dump(), second_motor(truth))  # type: ignore[arg-type]


def bits(bench: Bench, name: str) -> Iterator[Any]:
    """Link D-E of what the generator prints now, without optimisation."""
    for kind, step in bench.fresh("fast", name).steps.items():
        yield bits_of(bench.fresh("fast", name), bench.truth(name), kind, step).link(("-O0",))


def controller(bench: Bench, name: str) -> Iterator[Any]:
    """The interrupt's body, by hand and in C."""
    from runtime.proof.link_foc import link_control
    from runtime.proof.second import second_motor

    truth, fresh = bench.truth(name), bench.fresh("literal", name)
    yield from link_control(fresh, "ckf", truth.filter.gain, truth.model_dump(), second_motor(truth))  # type: ignore[arg-type]


def supervisor(bench: Bench, name: str) -> Iterator[Any]:
    """Every state of the machine; its modes by hand; supervisor and drive in C; the square wave by hand."""
    yield from _modes(bench.fresh("fast", name), bench.truth(name))


def aligned(bench: Bench, name: str) -> Iterator[Any]:
    """The same of a drive whose start is an alignment, which no shipped one is."""
    truth = bench.truth(name, kinds=("ckf",))
    truth = type(truth).model_validate(truth.model_dump() | {"start": {"method": "align"}})
    yield from _modes(Fresh(truth, "fast"), truth)


def _modes(fresh: Fresh, truth: Any) -> Iterator[Any]:
    from model.supervisor import supervisor as declared
    from runtime.proof.exhaust import link_exhaust
    from runtime.proof.link_drive import link_drive
    from runtime.proof.link_injection import link_injection
    from runtime.proof.link_modes import link_modes
    from runtime.proof.modes import Modes
    from runtime.proof.second import second_motor

    name, kind = truth.name, next(iter(fresh.steps))
    data, flux = truth.model_dump(), fresh.model.states[0].unit == "Wb"
    machine = declared(truth, fresh.model)
    yield link_exhaust(machine, name, truth.model.sample_time, Modes(data, flux).longest)
    yield link_modes(fresh, kind, truth.filter.gain, data, second_motor(truth))  # type: ignore[arg-type]
    yield from link_drive(fresh, kind, truth.filter.gain, data)  # type: ignore[arg-type]
    if hasattr(fresh.module, "inject"):
        yield link_injection(fresh.module, name, kind, truth.filter.gain, truth.control.dc_link)


def drive_lanes(bench: Bench, name: str) -> Iterator[Any]:
    """Supervisor and drive in lanes, by their scalar C."""
    from runtime.proof.link_drive_lanes import link_drive_lanes

    truth, fresh = bench.truth(name), bench.fresh("fast", name)
    yield link_drive_lanes(fresh, next(iter(fresh.steps)), truth.filter.gain, truth.model_dump())  # type: ignore[arg-type]


def bits_of(folder: Any, truth: Any, kind: str, step: Any, steps: int = BIT_STEPS, draws: int = BIT_DRAWS) -> Any:
    """Link D-E with the first divergence's place left out: that takes another compilation."""
    from codegen.evidence.box import sample_box
    from model.machines.state_space import build
    from runtime.proof.link_de import Bits
    from runtime.proof.own_trajectory import trajectory_of

    short = trajectory_of(truth, steps=steps)
    made = Bits(folder, step, short.u, short.y, sample_box(truth, build(truth), draws))
    made._first = lambda trace: None  # type: ignore[method-assign]
    return made


LINKS: dict[str, Callable[..., Iterator[Any]]] = {
    "model": model,
    "A-B": literal,
    "B-C": fast,
    "data": data,
    "D-E": bits,
    "controller": controller,
    "supervisor": supervisor,
    "aligned": aligned,
    "drive-lanes": drive_lanes,
}


# --- running them


def first_failure(check: str, bench: Bench) -> tuple[str, str] | None:
    """Which link or test is not passed, and what it says; None if all are.

    Raises
    ------
    Exception
        Whatever is no verdict.
    """
    word, _, rest = check.partition(" ")
    if word == "pytest":
        return run_pytest(rest)
    if word == "noticed":
        return run_pytest(rest, exceptions=True)
    if word == "regenerated":
        name, node = rest.split(" ", 1)
        with regenerated(bench, name):
            return run_pytest(node)
    if word == "example":
        name, node = rest.split(" ", 1)
        with rewritten(name, "example_isr.c", printed_example(bench.truth(name))):
            return run_pytest(node)
    for link in LINKS[word](bench, *rest.split()):
        if not link.passed:
            return verdict(link)
    return None


def printed_example(drive: Any) -> str:
    """The example interrupt as the (mutated) generator prints it now."""
    from codegen.generate import build_steps
    from codegen.render.drive import default_kind, render_example
    from codegen.render.filter import Description
    from model.machines.state_space import default_initial_state

    model, steps = build_steps(drive)
    return render_example(Description(drive, model, tuple(default_initial_state(drive))), steps[default_kind(steps)])


def verdict(link: Any) -> tuple[str, str]:
    """A failed link in few words."""
    row = next((row for row in link.rows if not row.passed), None)
    return f"link {link.name}", f"{link.drive}/{link.kind}: {link.divergence or row}"


@contextlib.contextmanager
def regenerated(bench: Bench, name: str) -> Iterator[None]:
    """The shipped drives' place is a folder in which this one is generated now; the others are as they are."""
    import runtime.estimator.folder as place
    from codegen.generate import generate
    from codegen.output.folder import write_folder

    assert place.GENERATED == ROOT / "generated", "modules keep the place they were loaded with: one folder a process"
    with tempfile.TemporaryDirectory() as scratch:
        write_folder(Path(scratch) / name, generate(bench.truth(name), samples=1).files)
        for other in place.GENERATED.iterdir():
            if other.name != name:
                (Path(scratch) / other.name).symlink_to(other)
        place.GENERATED = Path(scratch)
        yield


@contextlib.contextmanager
def rewritten(name: str, file: str, text: str) -> Iterator[None]:
    """The shipped drives' place is a folder in which one file of this drive has another text."""
    import runtime.estimator.folder as place

    with tempfile.TemporaryDirectory() as scratch:
        for other in place.GENERATED.iterdir():
            if other.name != name:
                (Path(scratch) / other.name).symlink_to(other)
        (Path(scratch) / name).mkdir()
        for path in (place.GENERATED / name).iterdir():
            if path.name != file:
                (Path(scratch) / name / path.name).symlink_to(path)
        (Path(scratch) / name / file).write_text(text, encoding="utf-8")
        place.GENERATED = Path(scratch)
        yield


class _Verdicts:
    """Tells a failed assertion from a crash."""

    def __init__(self, exceptions: bool) -> None:
        self.exceptions = exceptions
        self.failed: list[str] = []
        self.crashed: list[str] = []
        self.passed = 0

    def pytest_exception_interact(self, node: Any, call: Any, report: Any) -> None:
        kind = call.excinfo.type
        mere = self.exceptions or kind.__name__ in {"AssertionError", "Failed", "FailedHealthCheck", "DocTestFailure"}
        (self.failed if mere and report.when == "call" else self.crashed).append(
            f"{node.nodeid}: {call.excinfo.exconly()[:120]}"
        )

    def pytest_runtest_logreport(self, report: Any) -> None:
        self.passed += report.when == "call" and report.passed


def run_pytest(node: str, exceptions: bool = False) -> tuple[str, str] | None:
    """A test file or test, in this process; with ``exceptions`` one that the test meets when it calls is a failure too.

    That is for what judges and tells: its user would see a traceback in the place of a verdict.
    """
    import pytest

    seen = _Verdicts(exceptions)
    os.chdir(ROOT)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        pytest.main([*shlex.split(node), "-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist"], plugins=[seen])
    if seen.failed:
        return "test " + seen.failed[0].split(":")[0], seen.failed[0]
    if seen.crashed or not seen.passed:
        raise RuntimeError(seen.crashed[0] if seen.crashed else f"no test ran: {node}")
    return None


def overlaid(folder: Any, name: str, text: str) -> Any:
    """A generated folder in which one file has another text."""
    from runtime.estimator.folder import GeneratedFolder

    class Overlaid(GeneratedFolder):
        def text(self, file: str) -> str:
            return text if file == name else super().text(file)

    return Overlaid(folder.path, checked=False)


def forms_of(file: str) -> tuple[str, ...]:
    """Of link text's forms those that a file of a generated folder is part of; of the module the scalar ones."""
    if file.endswith(".py"):
        return ("C", "controller", "drive", "supervisor")
    if file.endswith(("_drive.c", "_supervisor.c")):
        return (file.rpartition("_")[2].removesuffix(".c"),)
    scalar, lanes = ("controller", "controller's lanes") if "_foc" in file else ("C", "lanes")
    return (lanes if "_lanes" in file else scalar,)


__all__ = ["Bench", "bits_of", "copy", "first_failure", "forms_of", "overlaid", "verdict"]
