"""modelDescription.xml of FMI 2.0 and 3.0."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree

from codegen.output.version import __version__
from runtime.exports.variables import FIXED, INPUT, INTEGER, OUTPUT, SINGLE, TUNABLE, Variable

#: Exponents of kg, m, s, A, rad of every unit that occurs, after the project's own spelling.
_BASE: dict[str, dict[str, int]] = {
    "A": {"A": 1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "H": {"kg": 1, "m": 2, "s": -2, "A": -2},
    "Wb": {"kg": 1, "m": 2, "s": -2, "A": -1},
    "rad": {"rad": 1},
    "s": {"s": 1},
    "m": {"m": 1},
    "kg": {"kg": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
}


def base_unit(unit: str) -> dict[str, int]:
    """Exponents of a unit such as ``N m s/rad`` or ``(rad/s)^2``.

    Parameters
    ----------
    unit : str

    Returns
    -------
    dict of str to int
        By base unit; zeros are left out.
    """
    inner, _, power = unit.removeprefix("(").partition(")^") if unit.startswith("(") else (unit, "", "")
    times = int(power or 1)
    above, _, below = inner.partition("/")
    found: dict[str, int] = {}
    for text, sign in ((above, 1), (below, -1)):
        for word in text.split():
            name, _, own = word.partition("^")
            for base, exponent in _BASE[name].items() if name != "1" else ():
                found[base] = found.get(base, 0) + sign * int(own or 1) * exponent * times
    return {base: exponent for base, exponent in found.items() if exponent}


def written(root: ElementTree.Element) -> bytes:
    """The file's bytes.

    Parameters
    ----------
    root : Element
    """
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'.encode()


def _root(version: str, name: str, token: str, words: str) -> ElementTree.Element:
    key = "guid" if version == "2.0" else "instantiationToken"
    return ElementTree.Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": name,
            key: token,
            "description": words,
            "generationTool": f"pmsm-ickf {__version__}",
            "variableNamingConvention": "structured",
        },
    )


def _units(root: ElementTree.Element, table: Sequence[Variable]) -> None:
    place = ElementTree.SubElement(root, "UnitDefinitions")
    for unit in dict.fromkeys(variable.unit for variable in table if variable.unit and variable.type != INTEGER):
        ElementTree.SubElement(
            ElementTree.SubElement(place, "Unit", name=unit),
            "BaseUnit",
            {base: str(exponent) for base, exponent in base_unit(unit).items()},
        )


def _attributes(variable: Variable, reference: int) -> dict[str, str]:
    causality = {INPUT: "input", OUTPUT: "output", TUNABLE: "parameter", FIXED: "parameter"}[variable.role]
    variability = {INPUT: "discrete", OUTPUT: "discrete", TUNABLE: "tunable", FIXED: "fixed"}[variable.role]
    return {
        "name": variable.name,
        "valueReference": str(reference),
        "description": variable.words,
        "causality": causality,
        "variability": variability,
    }


def description(
    version: str,
    name: str,
    token: str,
    words: str,
    sample_time: float,
    table: Sequence[Variable],
    starts: Sequence[str],
) -> bytes:
    """The model description as the FMU carries it.

    Parameters
    ----------
    version : {"2.0", "3.0"}
    name : str
        Of the model; the binary has it, too.
    token : str
    words : str
        What it is, in a line.
    sample_time : float
        s.
    table : sequence of Variable
        In the order of their references.
    starts : sequence of str
        Their values after instantiation, as text.
    """
    root = _root(version, name, token, words)
    (_two if version == "2.0" else _three)(root, name, sample_time, table, starts)
    return written(root)


def _two(root: ElementTree.Element, name: str, T: float, table: Sequence[Variable], starts: Sequence[str]) -> None:
    slave = ElementTree.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=name,
        canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUstate="true",
        canSerializeFMUstate="true",
    )
    ElementTree.SubElement(ElementTree.SubElement(slave, "SourceFiles"), "File", name=f"{name}.c")
    _units(root, table)
    ElementTree.SubElement(ElementTree.SubElement(root, "LogCategories"), "Category", name="logStatusError")
    ElementTree.SubElement(root, "DefaultExperiment", startTime="0", stepSize=repr(T))
    place = ElementTree.SubElement(root, "ModelVariables")
    for reference, (variable, start) in enumerate(zip(table, starts, strict=True)):
        about = _attributes(variable, reference)
        if variable.role == OUTPUT:
            about["initial"] = "calculated"
        entry = ElementTree.SubElement(place, "ScalarVariable", about)
        own = {} if variable.role == OUTPUT else {"start": start}
        if variable.type == INTEGER:
            ElementTree.SubElement(entry, "Integer", own)
        else:
            ElementTree.SubElement(entry, "Real", own | ({"unit": variable.unit} if variable.unit else {}))
    structure = ElementTree.SubElement(root, "ModelStructure")
    for kind in ("Outputs", "InitialUnknowns"):
        unknowns = ElementTree.SubElement(structure, kind)
        for index, variable in enumerate(table, start=1):
            if variable.role == OUTPUT:
                ElementTree.SubElement(unknowns, "Unknown", index=str(index))


def _three(root: ElementTree.Element, name: str, T: float, table: Sequence[Variable], starts: Sequence[str]) -> None:
    ElementTree.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=name,
        canHandleVariableCommunicationStepSize="true",
        fixedInternalStepSize=repr(T),
        canGetAndSetFMUState="true",
        canSerializeFMUState="true",
    )
    _units(root, table)
    ElementTree.SubElement(ElementTree.SubElement(root, "LogCategories"), "Category", name="logStatusError")
    ElementTree.SubElement(root, "DefaultExperiment", startTime="0", stepSize=repr(T))
    place = ElementTree.SubElement(root, "ModelVariables")
    ElementTree.SubElement(
        place,
        "Float64",
        name="time",
        valueReference=str(len(table)),
        causality="independent",
        variability="continuous",
        description="s",
    )
    for reference, (variable, start) in enumerate(zip(table, starts, strict=True)):
        about = _attributes(variable, reference)
        kind = "Int32" if variable.type == INTEGER else "Float32" if variable.type == SINGLE else "Float64"
        if variable.role == OUTPUT:
            about["initial"] = "calculated"
        else:
            about["start"] = start
        if variable.unit and variable.type != INTEGER:
            about["unit"] = variable.unit
        ElementTree.SubElement(place, kind, about)
    structure = ElementTree.SubElement(root, "ModelStructure")
    for kind in ("Output", "InitialUnknown"):
        for reference, variable in enumerate(table):
            if variable.role == OUTPUT:
                ElementTree.SubElement(structure, kind, valueReference=str(reference))
