"""The page that runs a filter on a recording that is dropped into it."""

from __future__ import annotations

import base64
import shutil
import tempfile
from pathlib import Path

import numpy as np
import sympy as sp

from codegen.render.equations import readable
from model.machines.state_space import build
from model.schema import Drive
from runtime.drive.experiment import simulate
from runtime.estimator.compiler import run_compiler
from runtime.estimator.folder import GeneratedFolder
from runtime.folders.resolve import NamedDrive
from runtime.recorded.units import RPM
from runtime.style.pages import page_template
from runtime.system.errors import UserError
from runtime.system.files import make_folder, write_text

#: Steps of the example that the page brings along.
EXAMPLE = 4000
#: Strict float32, as the proof has it; copies of structs are one instruction.
FLAGS = ("--target=wasm32", "-nostdlib", "-std=c99", "-O2", "-ffp-contract=off", "-mbulk-memory", "-Wl,--no-entry")


def compile_filter(folder: GeneratedFolder, kind: str) -> bytes:
    """The generated C of a filter as a WebAssembly module.

    Parameters
    ----------
    folder : GeneratedFolder
    kind : str

    Raises
    ------
    UserError
        A source is missing or was edited by hand; clang or wasm-ld is missing, or they refuse the source.
    """
    name = f"{folder.drive}_{kind}"
    sources = {file: folder.text(file) for file in (f"{name}.h", f"{name}.c", "pmsm_port.h")}
    missing = [name for name in ("clang", "wasm-ld") if shutil.which(name) is None]
    if missing:
        raise UserError(f"a page with a filter needs {' and '.join(missing)}: apt-get install clang lld.")
    with tempfile.TemporaryDirectory() as scratch:
        for file, text in sources.items():
            (Path(scratch) / file).write_text(text, encoding="utf-8")
        module = Path(scratch) / "filter.wasm"
        names = [f"-DFILTER={name}", f'-DHEADER="{name}.h"', f"-I{scratch}"]
        files = [str(Path(__file__).with_name("browser.c")), str(Path(scratch) / f"{name}.c")]
        command = ["clang", *FLAGS, *names, *files, "-o", str(module)]
        run_compiler(command, Path(scratch), "clang, for WebAssembly,")
        return module.read_bytes()


def write_browser_page(folder: GeneratedFolder, kind: str, named: NamedDrive, out: Path) -> Path:
    """Write index.html, which needs nothing else, to a folder; its path.

    Parameters
    ----------
    folder : GeneratedFolder
    kind : str
    named : NamedDrive
        What the folder was generated from: its equations, and what is simulated for the example.
    out : Path
    """
    drive = named.drive
    module = compile_filter(folder, kind)
    run = simulate(named.word, "load_step", (kind,))[0]
    columns = [run.u[:, 0], run.u[:, 1], run.i[:, 0], run.i[:, 1], run.omega, run.theta]
    example = np.column_stack(columns)[:EXAMPLE].astype("<f4")
    states = folder.manifest["states"]
    facts = {
        "drive": folder.drive,
        "kind": kind,
        "T": drive.model.sample_time,
        "states": [[state["name"], state["unit"]] for state in states],
        "per_rpm": RPM,
        "module": base64.b64encode(module).decode(),
        "example": base64.b64encode(example.tobytes()).decode(),
    }
    make_folder(out)
    text = page_template(Path(__file__).with_name("browser.html.j2")).render(facts=facts, measure=_measure(drive))
    write_text(out / "index.html", text)
    return out / "index.html"


def _measure(drive: Drive) -> str:
    """Expected currents as JavaScript, of x: the lines of h."""
    equations = readable(drive)
    states = [state.name for state in build(drive).states]
    lines = [f"const [{', '.join(states)}] = x;"]
    lines += [f"const {constant.name} = {constant.value!r};" for constant in equations.constants]
    lines += [f"const {left} = {sp.jscode(right)};" for left, right in equations.h]
    return "\n".join([*lines, "return [y_i_alpha, y_i_beta];"])
