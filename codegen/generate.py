"""The pipeline, five stages: build the filters, lay them out, print them, certify the print, assemble the folder.

>>> from model.drive import load_drive
>>> package = generate(load_drive("paper_spmsm"))
>>> sorted(name for name in package.files if name.endswith(".c"))
['host/paper_spmsm_ckf_f64.c', 'host/paper_spmsm_ickf_f64.c', 'paper_spmsm_ckf.c', 'paper_spmsm_ickf.c']
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from importlib.metadata import version
from typing import Any

from codegen import __version__
from codegen.box import sample_box
from codegen.certificate import SAMPLES, Certificate, certify
from codegen.cost import Cost, step_cost
from codegen.folder import with_manifest
from codegen.layout import Listing, lay_out
from codegen.printers.python import PythonPrinter
from codegen.recording import execute, record_control, record_filter
from codegen.render import Description, render_filter, render_module, render_port
from codegen.render_board import render_board
from codegen.render_drive import controller_context, default_kind, render_example, render_foc, render_plant
from codegen.render_selftest import SelfTest, render_control_selftest, render_filter_selftest
from codegen.report import render_report
from codegen.selftest import control_run, gains, segments
from codegen.targets import F28335, HOST64
from model.drive import Drive
from model.filters import FilterStep, build_filter
from model.state_space import StateSpaceModel, build, default_initial_state


@dataclass(frozen=True)
class Package:
    """Everything generated from one drive: file texts by path relative to the folder."""

    drive: Drive
    model: StateSpaceModel
    steps: dict[str, FilterStep]
    files: dict[str, str]


def generate(drive: Drive, samples: int = SAMPLES) -> Package:
    """Generate a drive's folder in memory; :func:`codegen.folder.write_folder` puts it on disk."""
    model, steps = build_steps(drive)
    listings = lay_out_steps(model, steps)
    costs = {
        kind: step_cost(step.body, listings, drive.filter.max_iterations, len(model.states))
        for kind, step in steps.items()
    }
    about = _describe(drive, model)
    module = render_module(about, steps, listings, controller_context(about, PythonPrinter()))
    certificates = certify_module(drive, model, steps, module, samples)
    tests = record_selftests(drive, model, steps, module)
    files = assemble(drive, model, steps, listings, costs, certificates, module, tests)
    return Package(drive, model, steps, files)


def build_steps(drive: Drive) -> tuple[StateSpaceModel, dict[str, FilterStep]]:
    """Stage 1: drive -> symbolic model -> one symbolic step a filter kind."""
    model = build(drive)
    return model, {kind: build_filter(model, kind, drive.filter.gain) for kind in dict.fromkeys(drive.filter.kinds)}


def lay_out_steps(model: StateSpaceModel, steps: dict[str, FilterStep]) -> dict[str, Listing]:
    """Stage 2: each block's tape, named and ordered; blocks that kinds share are laid out once."""
    constants = model.constants
    blocks = {block.name: block for step in steps.values() for block in step.blocks}
    return {name: lay_out(block, constants) for name, block in blocks.items()}


def certify_module(
    drive: Drive, model: StateSpaceModel, steps: dict[str, FilterStep], module: str, samples: int
) -> dict[str, Certificate]:
    """Stage 4: execute the printed module over the operating box in both precisions."""
    namespace = execute(module, f"generated_{drive.name}")
    box = sample_box(drive, model, samples)
    return {kind: certify(namespace, kind, box) for kind in steps}


def record_selftests(
    drive: Drive, model: StateSpaceModel, steps: dict[str, FilterStep], module: str
) -> dict[str, SelfTest]:
    """Stage 4, too: what the firmware must compute on a few recorded steps; by C name without the drive's."""
    about, runs, control = _describe(drive, model), segments(drive, model), control_run(drive)
    gain = gains(drive, control.delay).values
    tests: dict[str, SelfTest] = {}
    for kind in steps:
        tests[kind] = render_filter_selftest(about, kind, module, runs, record_filter(module, kind, runs))
        recording = record_control(module, kind, control, gain)
        tests[f"{kind}_foc"] = render_control_selftest(about, kind, control, recording)
    return tests


def assemble(
    drive: Drive,
    model: StateSpaceModel,
    steps: dict[str, FilterStep],
    listings: dict[str, Listing],
    costs: dict[str, Cost],
    certificates: dict[str, Certificate],
    module: str,
    tests: dict[str, SelfTest],
) -> dict[str, str]:
    """Stages 3 and 5: C for every kind and target, the report and the manifest."""
    about = _describe(drive, model)
    files = {"pmsm_port.h": render_port(), f"{drive.name}.py": module}
    for kind, step in steps.items():
        for target, folder in ((F28335, ""), (HOST64, "host/")):
            header, source = render_filter(about, step, listings, target, costs[kind], certificates[kind])
            stem = f"{folder}{drive.name}_{kind}{target.tag}"
            files[f"{stem}.h"], files[f"{stem}.c"] = header, source
        foc = f"{drive.name}_{kind}_foc"
        files[f"{foc}.h"], files[f"{foc}.c"] = render_foc(about, kind)
    for name, test in tests.items():
        stem = f"{drive.name}_{name}_selftest"
        files[f"{stem}.h"], files[f"{stem}.c"] = test.header, test.source
    files["example_isr.c"] = render_example(about, default_kind(steps))
    plant = f"host/{drive.name}_plant"
    files[f"{plant}.h"], files[f"{plant}.c"] = render_plant(about)
    files |= render_board(about, steps, {kind: files[f"{drive.name}_{kind}.c"] for kind in steps})
    files["REPORT.md"] = render_report(about, steps, costs, certificates, tests)
    return with_manifest(files, _facts(drive, model, steps, costs, certificates, tests))


def _describe(drive: Drive, model: StateSpaceModel) -> Description:
    return Description(drive, model, tuple(default_initial_state(drive)))


def _facts(
    drive: Drive,
    model: StateSpaceModel,
    steps: dict[str, FilterStep],
    costs: dict[str, Cost],
    certificates: dict[str, Certificate],
    tests: dict[str, SelfTest],
) -> dict[str, Any]:
    return {
        "drive": drive.name,
        "input_sha256": drive.sha256,
        "versions": {"pmsm-ickf": __version__, "casadi": version("casadi"), "sympy": version("sympy")},
        "parameters": drive.model_dump(exclude={"sha256", "name"}),
        "states": [{"name": state.name, "unit": state.unit} for state in model.states],
        "filters": {
            kind: {
                "gain": step.gain,
                "iteration": step.iteration_proof or ("bounded loop" if kind == "ickf" else "none"),
                "operations": costs[kind].operations,
                "estimated_cycles": costs[kind].cycles,
                "state_words": costs[kind].words,
                "certificate": _rounded(asdict(certificates[kind])),
                "selftest": {"vectors": tests[kind].vectors, "words": tests[kind].words},
            }
            for kind, step in steps.items()
        },
    }


def _rounded(certificate: dict[str, Any]) -> dict[str, Any]:
    """Two digits: what a certificate claims, and the same on every machine."""
    certificate["x"] = [float(f"{value:.1e}") for value in certificate["x"]]
    for name in ("P", "P_99"):
        certificate[name] = float(f"{certificate[name]:.1e}")
    return certificate
