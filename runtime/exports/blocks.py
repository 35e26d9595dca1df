"""A part as one C file for a block of Simulink (S-function) or of PLECS (C-Script)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from runtime.estimator.folder import GeneratedFolder
from runtime.exports.single_file import part_text
from runtime.exports.variables import FIXED, INPUT, OUTPUT, TUNABLE, Variable, by_port, variables
from runtime.system.errors import UserError

_OWN = Path(__file__).parent

_PORT = """
/* --- ports and parameters: vectors, in this order ------------------------------------------------------------- */

typedef struct {
    const char *name;
    unsigned first; /* reference of its first variable; the others follow it */
    unsigned count;
    int tunable;
} port_t;

"""

#: Sections of a C-Script, by the name of the dialog's entry.
SECTIONS = {
    "Start": """\
block_power_up();
/* block_set("{example}", 1.0); changes a value; names are listed at NAMES. */
block_begin();""",
    "Output, with inputs": """\
unsigned p, k;
block_prepare();
for (p = 0; p < INPUT_PORTS; p++) {{
    for (k = 0; k < INPUTS[p].count; k++) {{
        block_input(p, k, InputSignal(p, k));
    }}
}}
block_step();
for (p = 0; p < OUTPUT_PORTS; p++) {{
    for (k = 0; k < OUTPUTS[p].count; k++) {{
        OutputSignal(p, k) = block_output(p, k);
    }}
}}""",
    "Output, without": """\
unsigned p, k;
for (p = 0; p < OUTPUT_PORTS; p++) {{
    for (k = 0; k < OUTPUTS[p].count; k++) {{
        OutputSignal(p, k) = block_output(p, k);
    }}
}}""",
    "Update, with inputs": "block_accept();",
    "Update, without": """\
unsigned p, k;
block_prepare();
for (p = 0; p < INPUT_PORTS; p++) {{
    for (k = 0; k < INPUTS[p].count; k++) {{
        block_input(p, k, InputSignal(p, k));
    }}
}}
block_step();
block_accept();""",
}


def feeds_through(part: str) -> bool:
    """Whether outputs of a sample depend on its inputs: not the motor's, which are those of the instant.

    Parameters
    ----------
    part : {"filter", "drive", "motor"}
    """
    return part != "motor"


def sections(part: str) -> dict[str, str]:
    """Texts of a C-Script block's sections.

    Parameters
    ----------
    part : {"filter", "drive", "motor"}
    """
    kind = "with inputs" if feeds_through(part) else "without"
    example = {"filter": "nis_max", "drive": "delay", "motor": "sensor_bits"}[part]
    found = {"Start": SECTIONS["Start"]}
    found |= {name: SECTIONS[f"{name}, {kind}"] for name in ("Output", "Update")}
    return {name: text.format(example=example) for name, text in found.items()}


def block_name(folder: GeneratedFolder, kind: str, part: str) -> str:
    """Name of a part's block: that of the drive, its filter and the part.

    Parameters
    ----------
    folder : GeneratedFolder
    kind : str
        Filter kind.
    part : {"filter", "drive", "motor"}
    """
    return f"{folder.drive}_motor" if part == "motor" else f"{folder.drive}_{kind}_{part}"


def _ports_text(table: Sequence[Variable]) -> str:
    """The tables of ports and parameters in C, and each port's variables as a comment."""
    text = [_PORT]
    index = {variable.name: place for place, variable in enumerate(table)}
    for title, macro, roles in (
        ("INPUTS", "INPUT_PORTS", (INPUT,)),
        ("OUTPUTS", "OUTPUT_PORTS", (OUTPUT,)),
        ("PARAMETERS", "PARAMETER_PORTS", (TUNABLE, FIXED)),
    ):
        ports = by_port(tuple(table), *roles)
        text.append(f"#define {macro} {len(ports)}\nstatic const port_t {title}[{macro}] = {{\n")
        for name, found in ports.items():
            first = index[found[0].name]
            words = ", ".join(f"{entry.name} {entry.unit}".strip() for entry in found)
            tunable = int(found[0].role == TUNABLE)
            text.append(f'    {{"{name}", {first}u, {len(found)}u, {tunable}}}, /* {words} */\n')
        text.append("};\n\n")
    return "".join(text)


def _shared(folder: GeneratedFolder, kind: str, part: str) -> str:
    table = variables(folder, part)
    return (
        part_text(folder, kind, part, table, inverter_delay=1)
        + _ports_text(table)
        + "/* 1: outputs depend on the inputs of the same sample. */\n"
        + f"#define FEEDTHROUGH {int(feeds_through(part))}\n\n"
        + (_OWN / "values.h").read_text(encoding="utf-8")
    )


def sfunction_text(folder: GeneratedFolder, kind: str, part: str, name: str) -> str:
    """The C file of a level 2 S-function.

    Parameters
    ----------
    folder : GeneratedFolder
    kind : str
        Filter kind.
    part : {"filter", "drive", "motor"}
    name : str
        Of the S-function, and of its file without the ending.

    Raises
    ------
    UserError
        A name that C does not take.
    """
    if not (name.isidentifier() and name.isascii()):
        raise UserError(f"'{name}' is not the name of an S-function: letters, digits and _ alone, no digit first.")
    head = (
        f"/* {name}.c: {part} of {folder.drive} as a Simulink S-function. Made by pmsm-ickf export; do not edit. */\n"
    )
    body = (_OWN / "sfunction.c").read_text(encoding="utf-8").replace("BLOCK", name)
    return f"{head}#define S_FUNCTION_NAME {name}\n{_shared(folder, kind, part)}\n{body}"


def plecs_text(folder: GeneratedFolder, kind: str, part: str, name: str) -> str:
    """The C file of a C-Script block; its head says what belongs into the block's sections.

    Parameters
    ----------
    folder : GeneratedFolder
    kind : str
        Filter kind.
    part : {"filter", "drive", "motor"}
    name : str
        Of the file.
    """
    table = variables(folder, part)
    ports = [", ".join(str(len(found)) for found in by_port(table, role).values()) for role in (INPUT, OUTPUT)]
    lines = [
        f"{name}: {part} of {folder.drive} for a C-Script block of PLECS. Made by pmsm-ickf export; do not edit.",
        "",
        f"Setup: inputs [{ports[0]}], outputs [{ports[1]}], sample time {folder.module.SAMPLE_TIME!r},",
        f"direct feedthrough {int(feeds_through(part))}; no states. Each block has a copy of this file to itself.",
        "",
        "Code declarations:",
        f'    #include "{name}"',
    ]
    for section, text in sections(part).items():
        lines += [f"{section}:", *(f"    {line}" for line in text.replace("/*", "//").replace(" */", "").splitlines())]
    head = "/*\n" + "".join(f" * {line}".rstrip() + "\n" for line in lines) + " */\n"
    names = "".join(f'    "{variable.name}",\n' for variable in table)
    return (
        f"{head}{_shared(folder, kind, part)}\nstatic const char *const NAMES[VARIABLE_COUNT] = {{\n{names}}};\n\n"
        + (_OWN / "plecs.c").read_text(encoding="utf-8")
    )
