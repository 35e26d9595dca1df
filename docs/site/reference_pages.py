"""The pages of the reference, written from the code as the site is built: drive file, facts file, status, commands."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, get_args

import typer
from pydantic import BaseModel

from model.schema import Drive, Unit
from runtime.cli import GROUPS, app
from runtime.design.facts import FactsFile

ROOT = Path(__file__).parents[2]


def table(columns: Sequence[str], rows: Iterator[Sequence[str]] | Sequence[Sequence[str]]) -> str:
    """A table in Markdown; a stroke within a cell stays one."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


def plain(docstring: str) -> str:
    """A docstring as Markdown: code is code, and roles are names alone."""
    return re.sub(r":\w+:`~?([^`]+)`", r"`\1`", inspect.cleandoc(docstring or "")).replace("``", "`")


# --- files -------------------------------------------------------------------------------------------------------


def _number(value: float) -> str:
    return f"{value:g}"


def _allowed(entry: dict[str, Any]) -> str:
    """What a key may be, in words, from its JSON schema."""
    if "anyOf" in entry:
        return " or ".join(_allowed(way) for way in entry["anyOf"] if way.get("type") != "null")
    if "enum" in entry:
        return ", ".join(f"`{value}`" for value in entry["enum"])
    if "const" in entry:
        return f"`{entry['const']}`"
    if entry.get("type") == "array":
        return f"list of {_allowed(entry['items'])}"
    low, high = (entry.get(f"{end}imum") for end in ("min", "max"))
    if "exclusiveMinimum" in entry:
        return f"> {_number(entry['exclusiveMinimum'])} .. {_number(high)}"
    if low is not None and high is not None:
        return f"{_number(low)} .. {_number(high)}"
    return f"`{entry['pattern']}`" if "pattern" in entry else str(entry.get("type", "")).replace("string", "text")


def _unit(field: Any) -> str:
    """The unit of a key, wherever in its type it is annotated."""
    for part in (*field.metadata, *(item for way in get_args(field.annotation) for item in get_args(way))):
        if isinstance(part, Unit):
            return part.symbol
    return ""


def _default(key: str, section: dict[str, Any]) -> str:
    if key in section.get("required", ()):
        return "**must be stated**"
    value = section["properties"][key].get("default")
    return "" if value is None else f"`{str(value).lower() if isinstance(value, bool) else value}`"


def _ways(model: type[BaseModel]) -> Iterator[str]:
    """The quantities of a section of a facts file that can be stated in several ways."""
    for ways in getattr(model, "alternatives", ()):
        yield " or ".join(" with ".join(f"`{key}`" for key in way) for way in ways)


def _section(name: str, model: type[BaseModel]) -> str:
    schema = model.model_json_schema()
    rows = []
    for key, field in model.model_fields.items():
        entry = schema["properties"][key]
        said = field.description or ""
        rows.append((f"`{key}`", said, _unit(field), _allowed(entry), _default(key, schema)))
    chosen = "".join(f"- {way}\n" for way in _ways(model))
    chosen = f"State one of each line:\n\n{chosen}\n" if chosen else ""
    heading = f"## \\[{name}\\]\n\n{plain(model.__doc__ or '')}\n\n{chosen}"
    return heading + table(("key", "what", "unit", "allowed", "default"), rows)


def _sections(model: type[BaseModel]) -> Iterator[tuple[str, type[BaseModel]]]:
    for name, field in model.model_fields.items():
        for kind in (field.annotation, *get_args(field.annotation)):
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                yield name, kind


def drive_file() -> str:
    """The sections of a drive file, from its schema."""
    example = (ROOT / "model" / "drives" / "paper_spmsm.toml").read_text(encoding="utf-8")
    sections = "\n".join(_section(name, kind) for name, kind in _sections(Drive))
    return f"""# The drive file

What `pmsm-ickf generate` reads: `name`, then sections. This page is written from the schema that reads the file
(`model/schema.py`); a key that is not here is refused. Everything is in SI units, amplitude-invariant, the d axis on
the magnets' flux. [Regenerate](../regenerate.md) says how to use it.

`name`: {_allowed(Drive.model_json_schema()["properties"]["name"])}; it begins all names in the generated C.

{sections}
## The paper's drive

```toml
{example.strip()}
```
"""


def facts_file() -> str:
    """The sections of a facts file, from its model."""
    return """# The facts file

What `pmsm-ickf design` and `pmsm-ickf new` make a drive file from, and `pmsm-ickf identify` begins with: what a
nameplate, a data sheet or a meter says, in the units it is known in. [Design](../design.md) says what is made of it.

""" + "\n".join(_section(name, kind) for name, kind in _sections(FactsFile))


# --- status ------------------------------------------------------------------------------------------------------


EXIT_CODES = (
    ("0", "good"),
    ("1", "a check failed, a rotor was lost, a budget was exceeded: the text says which"),
    ("2", "bad input, in one line"),
    ("130", "interrupted by Ctrl-C; what was done is kept where the command says so"),
)


def status() -> str:
    """The bits of the status, modes and reasons, from the header that every generated folder has."""
    header = (ROOT / "generated" / "paper_spmsm" / "pmsm_port.h").read_text(encoding="utf-8")
    text = header[header.index("status of a step") :]
    names = re.findall(r"^#define (PMSM_\w+) (\w+) +/\* (.*?) \*/$", text, flags=re.MULTILINE)
    bits = [(f"`{name}`", value, said) for name, value, said in names if value.startswith("0x")]
    others = [row for row in names if not row[1].startswith("0x")]
    reasons = [(f"`{name}`", value, said) for name, value, said in others if "_REASON_" in name]
    modes = [(f"`{name}`", value, said) for name, value, said in others if "_REASON_" not in name]
    return f"""# Status, modes and reasons

The names are those of `pmsm_port.h`, which lies in every generated folder; this page is written from it. In Python the
bits are constants of the generated module, `INPUT_REJECTED` and so on, and `Trace.status` has them, a sample each.

## Bits of the status

0 is good. What to do about each bit: [firmware](../firmware.md#read-the-status).

{table(("bit", "value", "meaning"), bits)}
## Modes of the drive

`supervisor.mode`; what leads from one to another: [firmware](../firmware.md#the-modes-of-the-drive).

{table(("mode", "value", "meaning"), modes)}
## Why the rotor was given up

`supervisor.reason`.

{table(("reason", "value", "meaning"), reasons)}
## Exit codes of the commands

{table(("code", "meaning"), EXIT_CODES)}"""


# --- commands ----------------------------------------------------------------------------------------------------


def _default_of(parameter: Any) -> str:
    value = parameter.default
    if parameter.required:
        return "**must be stated**"
    if value in (None, "", (), []) or (parameter.is_flag if hasattr(parameter, "is_flag") else False):
        return ""
    return f"`{value}`"


def _rows(command: Any) -> Iterator[tuple[str, str, str]]:
    for parameter in command.params:
        said = plain((getattr(parameter, "help", None) or "").strip()).replace("<", "&lt;")
        if parameter.param_type_name == "argument":
            name = f"`{parameter.metavar or parameter.name.upper()}`"
        else:
            word = "" if parameter.is_flag else f" {parameter.metavar or parameter.name.upper()}"
            others = "".join(f", `{option}`" for option in parameter.opts[1:] + parameter.secondary_opts)
            name = f"`{parameter.opts[0]}{word}`{others}"
        yield name, said, _default_of(parameter)


def _command(name: str, command: Any, depth: int) -> str:
    said = plain(re.split(r"\n *Parameters\n *-+", command.help or "")[0].strip())
    text = f"{'#' * depth} {name}\n\n{said}\n\n"
    text += table(("argument or option", "what", "default"), list(_rows(command)))
    return text + "".join(f"\n{_command(f'{name} {sub}', inner, depth + 1)}" for sub, inner in subcommands(command))


def subcommands(command: Any) -> list[tuple[str, Any]]:
    """The commands of a group, by name, as it loads them; none of what is no group."""
    return [(name, command.get_command(None, name)) for name in getattr(command, "commands", {})]


def command_line() -> str:
    """All commands with their options, from the command line's own declaration."""
    known = dict(subcommands(typer.main.get_command(app)))
    commands = "\n".join(
        f"## {title}\n\n" + "\n".join(_command(name, known[name], 3) for name in names)
        for title, names in GROUPS.items()
    )
    return f"""# The command line

`pmsm-ickf COMMAND --help` says the same in a terminal; this page is written from the same declaration. DRIVE is always
a shipped name, a TOML file, or a generated folder.

{commands}"""


#: Path in the site -> the function that writes the page.
PAGES = {
    "reference/drive_file.md": drive_file,
    "reference/facts_file.md": facts_file,
    "reference/status.md": status,
    "reference/command_line.md": command_line,
}
