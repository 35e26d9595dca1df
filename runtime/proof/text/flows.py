"""The memory after a step in C or in Python: one term a cell, over the same inputs in each text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from runtime.proof.text.c_steps import CText, Pointer, Struct, Value
from runtime.proof.text.python_nodes import Record
from runtime.proof.text.python_steps import PythonText
from runtime.proof.text.terms import Key, Term, Terms

#: A cell's name and place -> its value.
Cells = dict[Key, Term]


def filter_in_c(text: CText, prefix: str, lanes: bool) -> Cells:
    """Every field of the filter's struct after a step, and the status.

    Parameters
    ----------
    text : CText
    prefix : str
        Beginning of the file's names, such as "paper_spmsm_ckf".
    lanes : bool
        It is the lane form, whose step returns no status.
    """
    f, kind = text.new_struct(f"{prefix}_t"), "lanes" if lanes else "float32"
    status = text.call(f"{prefix}_step", [f, text.new_input("u", 2, kind), text.new_input("y", 2, kind)])
    return struct_cells(text, f) | ({} if lanes else {("status", 0): term_of(text.terms, status)})


def filter_in_python(text: PythonText, name: str, fields: Record) -> Cells:
    """The same of the module's step; ``fields``: those of the C struct, as symbols.

    Parameters
    ----------
    text : PythonText
    name : str
        The step's function in the module.
    fields : Record
        Those of the C struct, as symbols; the step changes them.
    """
    inputs = [tuple(text.terms.symbol(port, k) for k in range(2)) for port in ("u", "y")]
    status = text.call(name, [fields, *inputs, None])
    return dict(record_cells(text.terms, fields)) | {("status", 0): term_of(text.terms, status)}


def controller_in_c(text: CText, prefix: str, filter_prefix: str, lanes: bool, written: Mapping[str, int]) -> Cells:
    """Every field of the controller's struct after a step, duty cycles and status; the filter's step is one call.

    Parameters
    ----------
    text : CText
    prefix : str
        Beginning of the controller's names, such as "paper_spmsm_ckf_foc".
    filter_prefix : str
        That of the filter's, such as "paper_spmsm_ckf".
    lanes : bool
        It is the lane form, whose step returns no status.
    written : mapping of str to int
        The fields that the filter's step writes, and their lengths.
    """
    c, kind = text.new_struct(f"{prefix}_t"), "lanes" if lanes else "float32"
    text.elsewhere[f"{filter_prefix}_step"] = lambda t, arguments: _filter_called_in_c(t, arguments, written, lanes)
    duty = text.new_array("duty", 3, kind)
    inputs = [text.new_input(port, 2, kind) for port in ("phase", "command")]
    status = text.call(f"{prefix}_step", [c, *inputs, Pointer(duty)])
    found = struct_cells(text, c) | {("duty", k): term_of(text.terms, text.read(duty, k)) for k in range(3)}
    found.pop(("filter.status", 0), None)
    return found | ({} if lanes else {("status", 0): term_of(text.terms, status)})


def controller_in_python(text: PythonText, fields: Record, written: Mapping[str, int]) -> Cells:
    """The same of the module's ``foc_step``.

    Parameters
    ----------
    text : PythonText
    fields : Record
        Those of the C struct, as symbols; the step changes them.
    written : mapping of str to int
        The fields that the filter's step writes, and their lengths.
    """
    text.elsewhere["filter_step"] = lambda arguments: _filter_called_in_python(text, arguments, written)
    inputs = [tuple(text.terms.symbol(port, k) for k in range(2)) for port in ("phase", "command")]
    step = text.terms.symbol("filter_step")
    found = text.call("foc_step", [fields, step, *inputs, None])
    duty, status = found if isinstance(found, tuple) and len(found) == 2 else ((), None)
    cells = dict(record_cells(text.terms, fields)) | {("duty", k): entry for k, entry in enumerate(duty)}
    return cells | {("status", 0): term_of(text.terms, status)}


def record_of(text: CText, struct: Struct) -> Record:
    """The fields of a C struct as the module's objects have them.

    Parameters
    ----------
    text : CText
        Holds the cells.
    struct : Struct
    """

    def field(value: Any) -> Any:
        if isinstance(value, dict):
            return record_of(text, value)
        cells = tuple(term_of(text.terms, text.read(value, k)) for k in range(value.size))
        return cells if value.is_array else cells[0]

    return Record({name: field(value) for name, value in struct.items()})


def written_fields(before: Record, after: Cells) -> dict[str, int]:
    """Fields that a step changes, and how many cells they have.

    Parameters
    ----------
    before : Record
    after : Cells
    """
    return {
        name: len(value) if isinstance(value, tuple) else 1
        for name, value in before.items()
        for k in range(len(value) if isinstance(value, tuple) else 1)
        if after.get((name, k)) is not (value[k] if isinstance(value, tuple) else value)
    }


# --- the filter, called by the controller


def _stepterm_of(terms: Terms, state: list[Term], v: Term, i: Term) -> Term:
    return terms.make("call", "filter_step", terms.make("array", *state), v, i)


def _filter_called_in_c(text: CText, arguments: list[Value], written: Mapping[str, int], lanes: bool) -> Value:
    f, v, i = arguments
    if not isinstance(f, dict):
        return text.terms.unknown("a filter")
    fields = sorted(name for name in f if name != "status")
    state = [term_of(text.terms, text.read(f[name], k)) for name in fields for k in range(f[name].size)]
    call = _stepterm_of(text.terms, state, text.cells(v), text.cells(i))
    for name, size in written.items():
        for k in range(size):
            text.memory[f[name].id, k] = text.terms.make("out", call, name, k, whole=f[name].whole)
    status = text.terms.make("out", call, "status", 0, whole=True)
    if lanes:
        text.memory[f["status"].id, 0] = status
    return status


def _filter_called_in_python(text: PythonText, arguments: list[Any], written: Mapping[str, int]) -> Any:
    terms = text.terms
    match arguments:
        case [Record() as f, tuple() | list() as v, tuple() | list() as i, _]:
            state = [cell for name in sorted(f) for cell in (f[name] if isinstance(f[name], tuple) else (f[name],))]
            call = _stepterm_of(terms, state, terms.make("array", *v), terms.make("array", *i))
            for name, size in written.items():
                whole = isinstance(f[name], Term) and f[name].whole
                cells = tuple(terms.make("out", call, name, k, whole=whole) for k in range(size))
                f[name] = cells if isinstance(f[name], tuple) else cells[0]
            return terms.make("out", call, "status", 0, whole=True)
    return terms.unknown("a call of the filter")


# --- cells


def term_of(terms: Terms, value: Any) -> Term:
    """The value of a cell; what is none is unknown.

    Parameters
    ----------
    terms : Terms
    value : Term, or anything else
    """
    return value if isinstance(value, Term) else terms.unknown("no value")


def struct_cells(text: CText, struct: Struct) -> Cells:
    """Every cell of a C struct, those of structs within it too.

    Parameters
    ----------
    text : CText
    struct : Struct
    """
    found: Cells = {}
    for value in struct.values():
        if isinstance(value, dict):
            found |= struct_cells(text, value)
        else:
            found |= {(value.name, k): term_of(text.terms, text.read(value, k)) for k in range(value.size)}
    return found


def record_cells(terms: Terms, record: Record, prefix: str = "") -> Iterator[tuple[Key, Term]]:
    """Every cell of the module's object, those of objects within it too.

    Parameters
    ----------
    terms : Terms
    record : Record
    prefix : str, optional
        Beginning of the names.
    """
    for name, value in record.items():
        if isinstance(value, Record):
            yield from record_cells(terms, value, f"{prefix}{name}.")
        else:
            for k, entry in enumerate(value if isinstance(value, tuple | list) else (value,)):
                yield (prefix + name, k), term_of(terms, entry)
