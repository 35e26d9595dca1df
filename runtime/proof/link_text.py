"""Link text: the generated C and the generated NumPy are the same program, for every input.

Blocks are straight lines of float32 operations; they are compared entry by entry: the same operations in the same order
on the same constants give the same bits. The flow around them (guards, loops, branches, masks, status bits) is carried
out on terms in each text, every function it calls included, and what it leaves in each field must be one and the same
term. Nothing but the texts is needed to see it, and both are read by parsers that are not ours. What a reader does not
understand equals nothing.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

from codegen.evidence.emitted import parse_emitted
from codegen.targets.find import find_target
from model.schema import DEFAULT_TARGET
from runtime.estimator.folder import GeneratedFolder
from runtime.proof.result import Link, Row
from runtime.proof.text.c_steps import CText
from runtime.proof.text.drive_flows import (
    Changes,
    drive_in_c,
    drive_in_python,
    function_in_c,
    function_in_python,
    functions_of,
    supervisor_in_c,
    supervisor_in_python,
)
from runtime.proof.text.expressions import Function, c_functions, python_functions
from runtime.proof.text.flows import (
    Cells,
    controller_in_c,
    controller_in_python,
    filter_in_c,
    filter_in_python,
    record_cells,
    record_of,
    written_fields,
)
from runtime.proof.text.python_nodes import Record
from runtime.proof.text.python_steps import PythonText
from runtime.proof.text.terms import Key, Terms

#: Blocks that each form has at least; a filter's own, such as ekf_time_update, go before those of the cubature filters.
MUST = {
    "C": ("sin_cos", "time_update"),
    "lanes": ("sin_cos", "time_update"),
    "controller": ("sin_cos", "control"),
    "controller's lanes": ("sin_cos", "control"),
    "supervisor": ("watch_turning", "read_probe"),
    "drive": (),
}


def link_text(folder: GeneratedFolder, kind: str, gain: str, forms: Sequence[str] = tuple(MUST)) -> Link:
    """Compare filter and controller, in C and in C's lane form, with the generated module.

    Parameters
    ----------
    folder
        The generated folder.
    kind, gain : str
        The filter.
    forms : sequence of str, optional
        Of :data:`MUST`, those that are compared; all of them make the link.

    Raises
    ------
    codegen.evidence.emitted.EmittedError
        A text is no C, or uses what the reader does not know.
    """
    texts = _Texts(folder, kind)
    rows = [row for form in forms for row in (*texts.block_rows(form), *texts.flow_rows(form))]
    files = ", ".join(texts.files[form] for form in forms)
    return Link("text", "C and NumPy are the same program", folder.drive, kind, gain, files, tuple(rows))


class _Texts:
    """One filter's texts in every form, read once."""

    def __init__(self, folder: GeneratedFolder, kind: str) -> None:
        stem = f"{folder.drive}_{kind}"
        self.folder, self.kind, self.stem = folder, kind, stem
        self.files = {
            "C": f"{stem}.c",
            "lanes": f"host/{stem}_lanes.c",
            "controller": f"{stem}_foc.c",
            "controller's lanes": f"host/{stem}_foc_lanes.c",
            "supervisor": f"{stem}_supervisor.c",
            "drive": f"{stem}_drive.c",
        }
        self.prefixes = {form: file.rpartition("/")[2].removesuffix(".c") for form, file in self.files.items()}
        self._trees: dict[str, Any] = {}
        self._found: dict[str, dict[str, Function]] = {}
        self.module_tree = ast.parse(folder.text(f"{folder.drive}.py"))
        self.wanted = python_functions(folder.module, self.module_tree)
        self.terms = Terms()

    def tree(self, form: str) -> Any:
        """A form's file as the chip's compiler would see it, parsed."""
        if form not in self._trees:
            self._trees[form] = self._parsed(self.files[form])
        return self._trees[form]

    def found(self, form: str) -> dict[str, Function]:
        """The functions in a form's file that compute."""
        if form not in self._found:
            self._found[form] = c_functions(self.tree(form))
        return self._found[form]

    def _parsed(self, file: str) -> Any:
        name = file.rpartition("/")[2]
        code = self.folder.text(file).replace("__restrict", "")  # which pycparser does not know, and computes nothing
        headers = ["pmsm_port.h", *(f"{own.removesuffix('.c')}.h" for own in self.files.values())]
        files = {header.rpartition("/")[2]: self.folder.text(header) for header in headers}
        files[name] = code
        # The macros of a target's instructions are C's own operators on the host, whose text this is.
        target = find_target(self.folder.manifest.get("target", DEFAULT_TARGET))
        return parse_emitted(files, name, target.data.macros if target.native else target.macros)[0]

    # --- blocks

    def block_rows(self, form: str) -> Iterator[Row]:
        found = self.found(form)
        needed = (own if (own := f"{self.kind}_{name}") in self.wanted else name for name in MUST[form])
        for name in dict.fromkeys([*needed, *found]):
            yield _block_row(form, name, self.wanted.get(name), found.get(name))

    # --- flow

    def _blocks(self, form: str) -> dict[str, tuple[int, ...]]:
        """Blocks that both texts of a form have, and how many values each port hands out; wrapping is carried out."""
        return {name: f.sizes for name, f in self.found(form).items() if name in self.wanted and name != "wrap_angle"}

    def _c(self, form: str) -> CText:
        return CText(self.terms, self.tree(form), self._blocks(form))

    def _python(self, form: str) -> PythonText:
        return PythonText(self.terms, self.folder.module, self.module_tree, self._blocks(form))

    def _fields(self, form: str) -> Record:
        """The struct of a scalar form, its fields as symbols."""
        text = self._c(form)
        return record_of(text, text.new_struct(f"{self.prefixes[form]}_t"))

    def _supervisor(self) -> CText:
        """The supervisor's text, and what the filter's own has of a reset."""
        text, own = self._c("supervisor"), self._c("C").functions
        text.functions |= {name: own[name] for name in ("restart", f"{self.stem}_reset") if name in own}
        return text

    @cached_property
    def _written(self) -> Mapping[str, int]:
        """The fields that the filter's step writes, as the module tells it."""
        return written_fields(
            self._fields("C"), filter_in_python(self._python("C"), f"{self.kind}_step", self._fields("C"))
        )

    @cached_property
    def _controller_changes(self) -> set[Key]:
        """The cells that the controller's step changes, as the module tells it."""
        before = dict(record_cells(self.terms, self._fields("controller")))
        after = controller_in_python(self._python("controller"), self._fields("controller"), self._written)
        return {key for key, value in before.items() if after.get(key) is not value}

    def flow_rows(self, form: str) -> Iterator[Row]:
        """A row for every field that the step of this form or the module's leaves."""
        lanes, prefix = "lanes" in form, self.prefixes[form]
        if form in {"C", "lanes"}:
            found = filter_in_c(self._c(form), prefix, lanes)
            wanted = filter_in_python(self._python(form), f"{self.kind}_step", self._fields("C"))
        elif form == "supervisor":
            yield from self._function_rows()
            return
        elif form == "drive":
            found = drive_in_c(self._c(form), self.stem, self._controller_changes)
            wanted = drive_in_python(self._python(form), self._fields(form), self._controller_changes)
        else:
            inner = f"{self.stem}_lanes" if lanes else self.stem
            found = controller_in_c(self._c(form), prefix, inner, lanes, self._written)
            wanted = controller_in_python(self._python(form), self._fields("controller"), self._written)
        yield from _flow_rows(form, wanted, found)

    def _function_rows(self) -> Iterator[Row]:
        """What the supervisor counts, and each action, by itself; then the table that calls them."""
        changes: dict[str, Changes] = {}
        for name in functions_of(self._supervisor(), self.stem):
            before = self._machine()
            found = function_in_c(self._supervisor(), name, self.stem)
            wanted, mask = function_in_python(self._python("supervisor"), name, *self._records())
            changed = {key for key, value in found.items() if value is not before[key]}
            own = {key for key, _ in record_cells(self.terms, self._fields("supervisor"))}
            changes[name] = Changes(frozenset(changed & own), frozenset(changed - own))
            masked = {key: self.terms.select(mask, value, before[key]) for key, value in found.items()}
            yield from _flow_rows(f"supervisor's {name}", wanted, masked)
        found = supervisor_in_c(self._supervisor(), self.stem, changes)
        wanted = supervisor_in_python(self._python("supervisor"), *self._records(), changes)
        yield from _flow_rows("supervisor", wanted, found)

    def _records(self) -> tuple[Record, Record]:
        return self._fields("supervisor"), self._fields("C")

    def _machine(self) -> Cells:
        """Every cell of the supervisor's and of the filter's struct before anything ran."""
        return {key: value for record in self._records() for key, value in record_cells(self.terms, record)}


def _block_row(form: str, name: str, wanted: Function | None, found: Function | None) -> Row:
    if wanted is None or found is None:
        return Row("13-34", f"{name}, {form}: in one language only", "each entry's expression", 1.0, 0.0, 1)
    compared = list(wanted.differences(found))
    different = [entry for entry, differs in compared if differs]
    stage = f"{name}, {form}" + (f": {different[0]}" if different else "")
    return Row("13-34", stage, "each entry's expression", float(len(different)), 0.0, len(compared))


def _flow_rows(form: str, wanted: Cells, found: Cells) -> Iterator[Row]:
    cells: dict[str, list[int]] = {}
    for name, k in dict.fromkeys([*wanted, *found]):
        cells.setdefault(name, []).append(k)
    for name, places in cells.items():
        different = [k for k in places if wanted.get((name, k)) is not found.get((name, k))]
        stage = f"step, {form}: {name}" + (f"[{different[0]}]" if different else "")
        yield Row("13-34", stage, "after the step, the same for every input", float(len(different)), 0.0, len(places))
