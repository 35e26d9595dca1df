"""The drive file as text: each number with its reason beside it; or an existing file edited, its comments kept."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from model.drives.text import EncodingError, read_text
from runtime.design.questions import meaning
from runtime.design.rules import Choice, Design
from runtime.system.errors import UserError

#: Columns of a line, its comment included; a longer comment stands above its key.
WIDEST = 120
#: Between the comment that a key had and what the rules say of its new value.
NOW = "; now: "


def drive_text(design: Design, facts_name: str) -> str:
    """A drive file with its reasons.

    Parameters
    ----------
    design : Design
    facts_name : str
        Name of the facts file, for the head.
    """
    lines = [
        f"# Made by pmsm-ickf design from {facts_name}: a value, and why it is that. Change what you know better, then",
        "# look at it again with pmsm-ickf generate, verify and simulate.",
        f"name = {json.dumps(design.name)}",
    ]
    for section, choices in design.sections.items():
        lines += ["", f"[{section}]"]
        for key, choice in choices.items():
            lines += _line(key, choice)
    return "\n".join(lines) + "\n"


def facts_text(tables: dict[str, Any]) -> str:
    """A facts file, with the meaning and the unit of each number beside it.

    Parameters
    ----------
    tables : dict
        As tomllib reads them; some may be missing yet.
    """
    lines = [
        "# What is known of a drive; pmsm-ickf design makes a drive file of it.",
        f"name = {toml_value(tables['name'])}",
    ]
    for section, keys in tables.items():
        if section != "name" and keys:
            lines += ["", f"[{section}]"]
            for key, value in keys.items():
                lines += _line(key, Choice(value, meaning(section, key)))
    return "\n".join(lines) + "\n"


def _line(key: str, choice: Choice) -> list[str]:
    entry = f"{key} = {toml_value(choice.value)}"
    line = f"{entry:<32} # {choice.reason}"
    return [line] if len(line) <= WIDEST else [f"# {choice.reason}", entry]


def toml_value(value: Any) -> str:
    """A value as TOML writes it: numbers to the last digit, as they are read back.

    Parameters
    ----------
    value : str, bool, int, float or list of those
    """
    if isinstance(value, list):
        return "[" + ", ".join(toml_value(entry) for entry in value) + "]"
    return json.dumps(value) if isinstance(value, str) else repr(value)


def edit_drive(design: Design, path: Path) -> str:
    """An existing drive file with the design's values in it: other keys, comments and order stay as they are.

    A comment beside a value that changes is kept, and what the rules say of the new one is added to it.

    Parameters
    ----------
    design : Design
    path : Path
        The drive file.

    Raises
    ------
    UserError
        The file cannot be read, or is another drive's.
    """
    import tomlkit

    document = read_document(path, design.name)
    for section, choices in design.sections.items():
        table = document.setdefault(section, tomlkit.table())
        if not isinstance(table, dict):
            raise UserError(f"'{path}': {section} is no section.")
        for key, choice in choices.items():
            if table.get(key) == choice.value:
                continue
            said = table[key].trivia.comment.lstrip("# ").partition(NOW)[0] if key in table else ""
            table[key] = choice.value
            table[key].comment(f"{said}{NOW}{choice.reason}" if said else choice.reason)
    return tomlkit.dumps(document)


def read_document(path: Path, name: str) -> Any:
    """A drive file that is to be edited, comments and all.

    Parameters
    ----------
    path : Path
    name : str
        What its drive must be called.

    Raises
    ------
    UserError
        The file cannot be read, or is another drive's.
    """
    try:
        import tomlkit
        from tomlkit.exceptions import TOMLKitError
    except ImportError:
        raise UserError("--write needs tomlkit: pip install 'pmsm-ickf[design]'. --out needs nothing.") from None
    try:
        document = tomlkit.parse(read_text(path))
    except OSError as error:
        raise UserError(f"'{path}' cannot be read: {error.strerror}. --out writes a new file.") from None
    except (TOMLKitError, EncodingError) as error:
        raise UserError(f"'{path}' is not valid TOML: {error}") from None
    if document.get("name") != name:
        raise UserError(
            f"'{path}' is the drive file of '{document.get('name')}', the facts are those of '{name}'. "
            "One of the two names must change, or --out write a file of its own."
        )
    return document
