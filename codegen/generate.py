"""The pipeline, five stages: build the filters, lay them out, print them, certify and count the print, assemble it.

Between the stages ``steps``, ``figures`` and ``accounts`` go by filter kind, ``listings`` by block, ``tests`` by C
name; ``files`` and ``bodies`` are texts by path relative to the folder.

>>> from model.drives.load import load_drive
>>> package = generate(load_drive("paper_spmsm"))
>>> sorted(name for name in package.files if name.startswith("paper_spmsm_ckf."))
['paper_spmsm_ckf.c', 'paper_spmsm_ckf.h']
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import ModuleType

import numpy as np

from codegen.evidence.box import sample_box
from codegen.evidence.budget import Account
from codegen.evidence.certificate import SAMPLES, ChipModel, Figures, certify, certify_chip
from codegen.evidence.ledger import Program
from codegen.evidence.measure import Measurer, Record
from codegen.evidence.recording import execute, record_control, record_filter
from codegen.evidence.selftest import control_run, gains, segments
from codegen.facts import facts, identity
from codegen.fast.steps import build_fast_filter
from codegen.ir.layout import Listing, lay_out
from codegen.output.folder import with_manifest
from codegen.passes import optimise
from codegen.render.board import render_board
from codegen.render.drive import controller_context, default_kind, plant_data, render_example, render_foc, render_plant
from codegen.render.drive_lanes import render_drive_lanes
from codegen.render.filter import Description, render_filter, render_port
from codegen.render.lanes import render_foc_lanes, render_lanes, render_plant_lanes
from codegen.render.module import render_module
from codegen.render.notes import cost_notes, filter_notes
from codegen.render.printers.python import PythonPrinter
from codegen.render.report import render_report
from codegen.render.selftest import SelfTest, render_control_selftest, render_filter_selftest
from codegen.render.supervisor import draw_supervisor, module_context, render_supervisor
from codegen.targets.find import find_target
from codegen.targets.numbers import FLOAT64, NumberFormat
from model.alignment import aligns
from model.filters import FilterStep, build_filter
from model.inverter import OF_LEGS
from model.machines.state_space import StateSpaceModel, build, default_initial_state
from model.schema import Drive, DriveError


@dataclass(frozen=True)
class Package:
    """Everything generated from one drive: file texts by path relative to the folder, and what the filters cost."""

    drive: Drive
    model: StateSpaceModel
    steps: dict[str, FilterStep]
    files: dict[str, str]
    accounts: dict[str, Account] = field(default_factory=dict)


def number_formats(about: Description) -> tuple[tuple[NumberFormat, str], ...]:
    """The number formats of the C printer, the target's first, and the folder of each.

    Parameters
    ----------
    about : Description
    """
    return (about.target.numbers, ""), (FLOAT64, "host/")


@contextmanager
def collector_at_rest() -> Iterator[None]:
    """Python's collector of circles rests: graphs and trees live to the end, and to look through them took a tenth.

    What it would have found is found after it.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


#: The shipped form exploits the model's structure; the literal one is the paper's, for reading and proving.
FORMS: dict[str, Callable[[StateSpaceModel, str, str], FilterStep]] = {
    "fast": build_fast_filter,
    "literal": build_filter,
}


@collector_at_rest()
def generate(drive: Drive, samples: int = SAMPLES, measurer: Measurer | None = None, form: str = "fast") -> Package:
    """Generate a drive's folder in memory; :func:`codegen.output.folder.write_folder` puts it on disk.

    Parameters
    ----------
    drive : Drive
    samples : int
        Draws from the operating box behind the certificate.
    measurer : Measurer, optional
        Where stack and code size come from; by default they are reported as not measured.
    form : {"fast", "literal"}
    """
    made = draft(drive, form)
    model, steps, about = made.about.model, made.steps, made.about
    with within_numbers(drive):
        figures = certify_module(about, steps, made.module, samples)
    bodies = print_c(about, steps, made.listings)
    accounts = count(drive, bodies)
    with within_numbers(drive):
        tests = record_selftests(about, steps, made.module)
    files = (
        with_heads(about, steps, bodies, figures, accounts)
        | {f"{drive.name}.py": made.module, "supervisor.svg": draw_supervisor(about, steps)}
        | print_tests(about, tests)
        | about.machine_file
    )
    measured = measure(accounts, files, measurer or Measurer())
    files["REPORT.md"] = render_report(about, steps, accounts, measured, figures, tests)
    about_it = facts(about, steps, accounts, measured, figures, tests)
    return Package(drive, model, steps, with_manifest(files, about_it), accounts)


@collector_at_rest()
def generate_bare(drive: Drive, form: str = "fast") -> Package:
    """All that computes and nothing that tells of it: a variant to be proved and thrown away.

    No certificate, cost, self-test or report; the manifest holds what it takes to load the folder.

    Parameters
    ----------
    drive : Drive
    form : {"fast", "literal"}
    """
    made = draft(drive, form)
    files = {**print_c(made.about, made.steps, made.listings), f"{drive.name}.py": made.module}
    known = identity(drive, made.about.model, made.steps) | {
        "filters": {kind: {"gain": step.gain} for kind, step in made.steps.items()},
        "plant": {"motor": plant_data(made.about)},
    }
    return Package(drive, made.about.model, made.steps, with_manifest(files, known))


@dataclass(frozen=True)
class Draft:
    """The filters as they can be executed: their symbolic steps, laid out, and the Python module's text."""

    about: Description
    steps: dict[str, FilterStep]
    listings: dict[str, Listing]
    module: str

    def load(self, name: str) -> ModuleType:
        """The Python module, executed.

        Parameters
        ----------
        name : str
            What the module is called from then on.
        """
        module = ModuleType(name)
        exec(compile(self.module, f"{name}.py", "exec"), module.__dict__)
        return module


def draft(drive: Drive, form: str = "fast") -> Draft:
    """Stages 1 and 2, and of stage 3 the Python module: no C is printed, nothing is certified or counted.

    Parameters
    ----------
    drive : Drive
    form : {"fast", "literal"}
    """
    model, steps = build_steps(drive, form)
    listings = lay_out_steps(model, steps)
    about = Description(drive, model, tuple(default_initial_state(drive)))
    around = controller_context(about, PythonPrinter()) | module_context(about, next(iter(steps.values())))
    return Draft(about, steps, listings, render_module(about, steps, listings, around))


@contextmanager
def within_numbers(drive: Drive) -> Iterator[None]:
    """DriveError where a drive, each number in its range, cannot be computed with: they do not fit each other.

    Single samples that do not stay numbers are counted in the certificate; NumPy need not warn of them as well.

    Parameters
    ----------
    drive : Drive
    """
    try:
        with np.errstate(all="ignore"):
            yield
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise DriveError(
            f"drive '{drive.name}': {str(error).rstrip('.')}, when its filter is tried out. Motor data, sample time, "
            "variances and operating box do not fit each other: compare them with a shipped drive's."
        ) from None


def build_steps(drive: Drive, form: str = "fast") -> tuple[StateSpaceModel, dict[str, FilterStep]]:
    """Stage 1: drive -> symbolic model -> one symbolic step a filter kind.

    Parameters
    ----------
    drive : Drive
    form : {"fast", "literal"}
    """
    model = build(drive)
    return model, {kind: FORMS[form](model, kind, drive.filter.gain) for kind in dict.fromkeys(drive.filter.kinds)}


def lay_out_steps(model: StateSpaceModel, steps: dict[str, FilterStep]) -> dict[str, Listing]:
    """Stage 2: each block's tape, named and ordered; blocks that kinds share are laid out once.

    Parameters
    ----------
    model : StateSpaceModel
    steps : dict of str to FilterStep
    """
    constants = [*model.constants, *(OF_LEGS if model.lost else ())]
    blocks = {block.name: block for step in steps.values() for block in step.blocks}
    return {name: lay_out(optimise(block), constants) for name, block in blocks.items()}


def certify_module(about: Description, steps: dict[str, FilterStep], module: str, samples: int) -> dict[str, Figures]:
    """Stage 4: execute the printed module over the operating box, in both precisions and on the chip's model.

    Parameters
    ----------
    about : Description
    steps : dict of str to FilterStep
    module : str
        Text of the Python module.
    samples : int
        Draws from the operating box.
    """
    namespace = execute(module, f"generated_{about.drive.name}")
    box, arithmetic = sample_box(about.drive, about.model, samples), about.target.arithmetic

    def chip(kind: str) -> ChipModel | None:
        return certify_chip(namespace, kind, box, arithmetic.number, arithmetic.sin_cos) if arithmetic else None

    return {kind: Figures(certify(namespace, kind, box), chip(kind)) for kind in steps}


def record_selftests(about: Description, steps: dict[str, FilterStep], module: str) -> dict[str, SelfTest]:
    """Stage 4, too: what the firmware must compute on a few recorded steps; by C name without the drive's.

    Parameters
    ----------
    about : Description
    steps : dict of str to FilterStep
    module : str
        Text of the Python module.
    """
    runs, control = segments(about.drive, about.model), control_run(about.drive)
    native = bool(about.target.numbers.turns)
    gain = gains(about.drive, control.delay).values
    tests: dict[str, SelfTest] = {}
    for kind in steps:
        tests[kind] = render_filter_selftest(about, kind, module, runs, record_filter(module, kind, runs, native))
        recording = record_control(module, kind, control, gain, native)
        tests[f"{kind}_foc"] = render_control_selftest(about, kind, control, recording)
    return tests


def print_tests(about: Description, tests: dict[str, SelfTest]) -> dict[str, str]:
    """The self-tests' files."""
    files = {}
    for name, test in tests.items():
        stem = f"{about.drive.name}_{name}_selftest"
        files[f"{stem}.h"], files[f"{stem}.c"] = test.header, test.source
    return files


#: Stands in a head for what is known once the text below it is counted and executed.
OPEN_HEAD = "(notes)"


def print_c(about: Description, steps: dict[str, FilterStep], listings: dict[str, Listing]) -> dict[str, str]:
    """Stage 3: C for every kind and number format. The heads are open: :func:`with_heads` closes them.

    Parameters
    ----------
    about : Description
    steps : dict of str to FilterStep
    listings : dict of str to Listing
    """
    name = about.drive.name
    files = {"pmsm_port.h": render_port(about.target)}
    for kind, step in steps.items():
        for numbers, folder in number_formats(about):
            header, source = render_filter(about, step, listings, numbers, [OPEN_HEAD])
            stem = f"{folder}{name}_{kind}{numbers.tag}"
            files[f"{stem}.h"], files[f"{stem}.c"] = header, source
        lanes = f"host/{name}_{kind}_lanes"
        files[f"{lanes}.h"], files[f"{lanes}.c"] = render_lanes(about, step, listings)
        foc = f"{name}_{kind}_foc"
        files[f"{foc}.h"], files[f"{foc}.c"] = render_foc(about, kind, [OPEN_HEAD])
        own = render_supervisor(about, step, [OPEN_HEAD]).items()
        files |= {f"{name}_{kind}_{end}": text for end, text in own}
        files[f"host/{foc}_lanes.h"], files[f"host/{foc}_lanes.c"] = render_foc_lanes(about, step)
        if not aligns(about.drive):  # lanes have no alignment
            whole = f"host/{name}_{kind}_drive_lanes"
            files[f"{whole}.h"], files[f"{whole}.c"] = render_drive_lanes(about, step)
    kind = default_kind(steps)
    files["example_isr.c"] = render_example(about, steps[kind])
    plant = f"host/{name}_plant"
    files[f"{plant}.h"], files[f"{plant}.c"] = render_plant(about)
    files[f"{plant}_lanes.h"], files[f"{plant}_lanes.c"] = render_plant_lanes(about)
    return files


def with_heads(
    about: Description,
    steps: dict[str, FilterStep],
    bodies: dict[str, str],
    figures: dict[str, Figures],
    accounts: dict[str, Account],
) -> dict[str, str]:
    """Stage 5: the heads say what the texts below them cost and how far they can be trusted; the board's files."""
    files, name = dict(bodies), about.drive.name
    for kind, step in steps.items():
        account, certificate, chip = accounts[kind], figures[kind].certificate, figures[kind].chip
        for numbers, folder in number_formats(about):
            source = f"{folder}{name}_{kind}{numbers.tag}.c"
            target = about.target if numbers is about.target.numbers else None
            notes = filter_notes(step, target, about.model.states, account, certificate, chip)
            files[source] = _with_notes(files[source], notes)
        foc = f"{name}_{kind}_foc.c"
        notes = cost_notes(account.controller, account.prices, "Cost at most, with the filter")
        files[foc] = _with_notes(files[foc], notes)
        whole = f"{name}_{kind}_drive.c"
        notes = [
            line
            for mode, ledger in account.interrupts.items()
            for line in cost_notes(ledger, account.prices, f"Cost at most, a whole interrupt, {mode}")
        ]
        files[whole] = _with_notes(files[whole], notes)
    return files | render_board(about, steps, {kind: files[f"{name}_{kind}.c"] for kind in steps})


def _with_notes(text: str, notes: list[str]) -> str:
    return text.replace(f" * {OPEN_HEAD}\n", "".join(f" * {line}\n" for line in notes), 1)


def count(drive: Drive, files: dict[str, str]) -> dict[str, Account]:
    """Read the emitted C back and open an account for each filter.

    Parameters
    ----------
    drive : Drive
    files : dict of str to str
    """
    accounts: dict[str, Account] = {}
    for kind in dict.fromkeys(drive.filter.kinds):
        name = f"{drive.name}_{kind}"
        sources = [f"{name}{end}.c" for end in ("", "_foc", "_supervisor", "_drive")]
        program = Program(files, *sources, target=find_target(drive.target_name))
        accounts[kind] = Account(program, name, drive.filter.max_iterations)
    return accounts


def measure(accounts: dict[str, Account], files: dict[str, str], measurer: Measurer) -> dict[str, Record]:
    """Stack and code size of each step, by the function's name.

    Parameters
    ----------
    accounts : dict of str to Account
    files : dict of str to str
    measurer : Measurer
        Takes what was kept for the same code, else measures.
    """
    ends = ("_step", "_foc_step", "_drive_step")
    functions = [(account, f"{account.name}{end}") for account in accounts.values() for end in ends]
    return {function: measurer(files, account.program, function) for account, function in functions}
