"""The memory after an interrupt of supervisor and drive, in C or in Python, as :mod:`runtime.proof.text.flows` has it.

The supervisor's text is compared in two floors: each function that it calls (what is counted, and an action each) by
itself, then the table, in which such a function is one call that may change what it was seen to change.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass
from typing import Any

from runtime.proof.text.c_steps import CText, Pointer, Value
from runtime.proof.text.flows import Cells, record_cells, struct_cells, term_of
from runtime.proof.text.python_nodes import Record
from runtime.proof.text.python_steps import PythonText
from runtime.proof.text.terms import Key, Term, Terms

# --- the supervisor's functions


def functions_of(text: CText, prefix: str) -> list[str]:
    """Functions that the supervisor calls with its struct or the filter's: what is counted, and the actions.

    Parameters
    ----------
    text : CText
    prefix : str
        Beginning of the filter's names, such as "paper_spmsm_ckf".
    """
    given = {name: [p.name for p in d.decl.type.args.params] for name, d in text.functions.items()}
    inline = {"go", "tell", "restart"}
    return [
        name
        for name, parameters in given.items()
        if set(parameters) & {"s", "f"} and name not in inline and not name.startswith(prefix)
    ]


def function_in_c(text: CText, name: str, prefix: str) -> Cells:
    """Every field after a function of the supervisor.

    Parameters
    ----------
    text : CText
    name : str
    prefix : str
        Beginning of the filter's names, such as "paper_spmsm_ckf".
    """
    s, f = text.new_struct(f"{prefix}_supervisor_t"), text.new_struct(f"{prefix}_t")
    given = {"s": s, "f": f, **_inputs_in_c(text)}
    text.call(name, [given[p.name] for p in text.functions[name].decl.type.args.params])
    return struct_cells(text, s) | struct_cells(text, f)


def function_in_python(text: PythonText, name: str, machine: Record, fields: Record) -> tuple[Cells, Term]:
    """The same of the module's function, and the mask that it was given: where it is 0, nothing may change.

    Parameters
    ----------
    text : PythonText
    name : str
        Without the underscore that it begins with.
    machine, fields : Record
        Fields of the C structs, the supervisor's and the filter's, as symbols; the function changes them.
    """
    terms = text.terms
    mask = terms.truth(terms.symbol("where", whole=True))
    given = {"s": machine, "f": fields, "where": mask, "math": None, **_inputs_in_python(terms)}
    parameters = [argument.arg for argument in text.functions[f"_{name}"].args.args]
    text.call(f"_{name}", [given[parameter] for parameter in parameters])
    cells = dict(record_cells(terms, machine)) | dict(record_cells(terms, fields))
    return cells, mask if "where" in parameters else terms.one


def _inputs_in_c(text: CText) -> dict[str, Value]:
    terms = text.terms
    named = {"status": terms.symbol("status", whole=True), "reference": terms.symbol("reference")}
    return {"phase": text.new_input("phase", 2, "float32"), **named}


def _inputs_in_python(terms: Terms) -> dict[str, Any]:
    named = {"status": terms.symbol("status", whole=True), "reference": terms.symbol("reference")}
    return {"phase": tuple(terms.symbol("phase", k) for k in range(2)), **named}


# --- the supervisor's table


@dataclass(frozen=True)
class Changes:
    """The cells that a function changes: of the supervisor's struct, and of the filter's that it is given."""

    machine: frozenset[Key]
    filter: frozenset[Key]


def supervisor_in_c(text: CText, prefix: str, changes: Mapping[str, Changes]) -> Cells:
    """Every field of the supervisor's and of the filter's struct after an interrupt, and the transition's number.

    Parameters
    ----------
    text : CText
    prefix : str
        Beginning of the filter's names, such as "paper_spmsm_ckf".
    changes : mapping of str to Changes
        By function.
    """
    s, f = text.new_struct(f"{prefix}_supervisor_t"), text.new_struct(f"{prefix}_t")

    def called(name: str, changed: Changes) -> Any:
        parameters = [p.name for p in text.functions[name].decl.type.args.params]

        def call(t: CText, arguments: list[Value]) -> Value:
            given = dict(zip(parameters, arguments, strict=True))
            target = given.get("f", f)
            before = struct_cells(t, s) | struct_cells(t, f)
            made = t.terms.make("call", name, target is f, *(before[key] for key in sorted(before)))
            _overwrite_struct(t, s, made, changed.machine)
            _overwrite_struct(t, target, made, changed.filter)
            return None

        return call

    text.elsewhere |= {name: called(name, changed) for name, changed in changes.items()}
    given = _inputs_in_c(text)
    taken = text.call(f"{prefix}_supervise", [s, f, given["status"], given["phase"], given["reference"]])
    return struct_cells(text, s) | struct_cells(text, f) | {("taken", 0): term_of(text.terms, taken)}


def supervisor_in_python(text: PythonText, machine: Record, fields: Record, changes: Mapping[str, Changes]) -> Cells:
    """The same of the module's ``supervise``.

    What a function is given is asked for the lanes of its mask alone: transitions of other lanes went before.

    Parameters
    ----------
    text : PythonText
    machine, fields : Record
        Fields of the C structs, the supervisor's and the filter's, as symbols; the step changes them.
    changes : mapping of str to Changes
        By function.
    """
    terms = text.terms

    def called(name: str, changed: Changes) -> Any:
        def call(arguments: list[Any]) -> Any:
            s, target, *_ = arguments
            where = arguments[3] if name != "watch" else terms.one
            before = dict(record_cells(terms, s)) | dict(record_cells(terms, fields))
            own = target is not s.get("rival")
            made = terms.make("call", name, own, *(terms.within(where, before[key]) for key in sorted(before)))
            _overwrite_record(terms, s, made, changed.machine, where)
            _overwrite_record(terms, target, made, changed.filter, where)
            return None

        return call

    known = {f"_{name}": called(name, changed) for name, changed in changes.items()}
    text.functions = {name: d for name, d in text.functions.items() if name not in known}
    text.elsewhere |= known
    given = _inputs_in_python(terms)
    taken = text.call("supervise", [machine, fields, given["status"], given["phase"], given["reference"], None])
    cells = dict(record_cells(terms, machine)) | dict(record_cells(terms, fields))
    return cells | {("taken", 0): term_of(terms, taken)}


# --- the drive


def drive_in_c(text: CText, prefix: str, changes: Set[Key]) -> Cells:
    """Every field of the drive's struct after an interrupt, duty cycles and the inverter.

    The controller's step and the supervisor's are a call each; the supervisor's may change all that it is given.

    Parameters
    ----------
    text : CText
    prefix : str
        Beginning of the filter's names, such as "paper_spmsm_ckf".
    changes : set of Key
        The cells of its struct that the controller's step changes.
    """
    terms, d, duty = text.terms, text.new_struct(f"{prefix}_drive_t"), text.new_array("duty", 3, "float32")

    def controller(t: CText, arguments: list[Value]) -> Value:
        c, phase, command, given = arguments
        call = terms.make("call", "controller", _all_of_struct(t, c), t.cells(phase), t.cells(command))
        _overwrite_struct(t, c, call, changes)
        if isinstance(given, Pointer):
            for k in range(3):
                t.memory[given.array.id, given.offset + k] = terms.make("out", call, "duty", k)
        return terms.make("out", call, "status", 0, whole=True)

    def rival(t: CText, arguments: list[Value]) -> Value:
        f, v, i = arguments
        call = terms.make("call", "rival", _all_of_struct(t, f), t.cells(v), t.cells(i))
        _overwrite_struct(t, f, call)
        return terms.make("out", call, "status", 0, whole=True)

    def supervise(t: CText, arguments: list[Value]) -> Value:
        s, f, status, phase, reference = arguments
        structs = (_all_of_struct(t, part) for part in (s, f))
        call = terms.make("call", "supervise", *structs, status, t.cells(phase), reference)
        _overwrite_struct(t, s, call)
        _overwrite_struct(t, f, call)
        return terms.make("out", call, "taken", 0, whole=True)

    text.elsewhere |= {f"{prefix}_foc_step": controller, f"{prefix}_supervise": supervise, f"{prefix}_step": rival}
    inputs = [text.new_input(port, 2, "float32") for port in ("phase", "command")]
    inverter = text.call(f"{prefix}_drive_step", [d, *inputs, Pointer(duty)])
    found = struct_cells(text, d) | {("duty", k): term_of(terms, text.read(duty, k)) for k in range(3)}
    return found | {("inverter", 0): term_of(terms, inverter)}


def drive_in_python(text: PythonText, fields: Record, changes: Set[Key]) -> Cells:
    """The same of the module's ``drive_step``.

    Parameters
    ----------
    text : PythonText
    fields : Record
        Those of the C struct, as symbols; the step changes them.
    changes : set of Key
        The cells of its struct that the controller's step changes.
    """
    terms = text.terms

    def controller(arguments: list[Any]) -> Any:
        match arguments:
            case [Record() as c, _, tuple() | list() as phase, tuple() | list() as command, _]:
                given = (terms.make("array", *values) for values in (_all_of_record(terms, c), phase, command))
                call = terms.make("call", "controller", *given)
                _overwrite_record(terms, c, call, changes)
                duty = tuple(terms.make("out", call, "duty", k) for k in range(3))
                return duty, terms.make("out", call, "status", 0, whole=True)
        return terms.unknown("a call of the controller")

    def rival(arguments: list[Any]) -> Any:
        match arguments:
            case [Record() as f, tuple() | list() as v, tuple() | list() as i, _]:
                given = (terms.make("array", *values) for values in (_all_of_record(terms, f), v, i))
                call = terms.make("call", "rival", *given)
                _overwrite_record(terms, f, call)
                return terms.make("out", call, "status", 0, whole=True)
        return terms.unknown("a call of the rival's step")

    def supervise(arguments: list[Any]) -> Any:
        match arguments:
            case [Record() as s, Record() as f, Term() as status, tuple() | list() as phase, Term() as reference, _]:
                structs = (terms.make("array", *_all_of_record(terms, part)) for part in (s, f))
                call = terms.make("call", "supervise", *structs, status, terms.make("array", *phase), reference)
                _overwrite_record(terms, s, call)
                _overwrite_record(terms, f, call)
                return terms.make("out", call, "taken", 0, whole=True)
        return terms.unknown("a call of the supervisor")

    text.functions = {k: v for k, v in text.functions.items() if k not in {"foc_step", "supervise"}}
    text.elsewhere |= {"foc_step": controller, "supervise": supervise, "filter_step": rival}
    inputs = [tuple(terms.symbol(port, k) for k in range(2)) for port in ("phase", "command")]
    found = text.call("drive_step", [fields, terms.symbol("filter_step"), *inputs, None])
    duty, inverter = found if isinstance(found, tuple) and len(found) == 2 else ((), None)
    cells = dict(record_cells(terms, fields)) | {("duty", k): term_of(terms, entry) for k, entry in enumerate(duty)}
    return cells | {("inverter", 0): term_of(terms, inverter)}


# --- a call that may change all of a struct


def _all_of_struct(text: CText, struct: Value) -> Term:
    if not isinstance(struct, dict):
        return text.terms.unknown("a struct")
    cells = struct_cells(text, struct)
    return text.terms.make("array", *(cells[key] for key in sorted(cells)))


def _overwrite_struct(text: CText, struct: Value, call: Term, only: Set[Key] | None = None, prefix: str = "") -> None:
    if not isinstance(struct, dict):
        return
    for name, value in struct.items():
        if isinstance(value, dict):
            _overwrite_struct(text, value, call, only, f"{prefix}{name}.")
            continue
        for k in range(value.size):
            if only is None or (prefix + name, k) in only:
                text.memory[value.id, k] = text.terms.make("out", call, prefix + name, k, whole=value.whole)


def _all_of_record(terms: Terms, record: Record) -> list[Term]:
    cells = dict(record_cells(terms, record))
    return [cells[key] for key in sorted(cells)]


def _overwrite_record(
    terms: Terms, record: Record, call: Term, only: Set[Key] | None = None, where: Term | None = None, prefix: str = ""
) -> None:
    for name, value in record.items():
        if isinstance(value, Record):
            _overwrite_record(terms, value, call, only, where, f"{prefix}{name}.")
            continue
        made = [
            _overwritten(terms, cell, call, (prefix + name, k), only, where)
            for k, cell in enumerate(value if isinstance(value, tuple | list) else (value,))
        ]
        record[name] = tuple(made) if isinstance(value, tuple | list) else made[0]


def _overwritten(terms: Terms, cell: Any, call: Term, key: Key, only: Set[Key] | None, where: Term | None) -> Any:
    if only is not None and key not in only:
        return cell
    made = terms.make("out", call, *key, whole=isinstance(cell, Term) and cell.whole)
    return made if where is None else terms.select(where, made, cell)
