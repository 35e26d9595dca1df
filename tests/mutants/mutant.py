"""A mutant, its outcomes, and how its change is put in."""

from __future__ import annotations

import hashlib
import importlib.machinery
import importlib.util
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

ROOT = Path(__file__).parents[2]


class StaleMutantError(Exception):
    """A mutant's place is not found exactly once: the code has moved on, and the mutant must follow."""


@dataclass(frozen=True)
class Mutant:
    """One small error.

    ``checks`` are tried in this order, see :mod:`tests.mutants.checks`. The change is one of: ``old`` to ``new`` in a
    source ``file``; ``drive``, from the drive file's data to what the generator is given; ``text``, from a file of a
    generated folder (``file``) to what it is replaced by.
    """

    kind: str
    name: str
    checks: tuple[str, ...]
    file: str = ""
    old: str = ""
    new: str = ""
    drive: Callable[[Any], Any] | None = None
    text: str = ""
    #: Why no check can tell it from the original; such a mutant counts neither way.
    equivalent: str = ""
    #: Mutants of one group share the preparation of their checks.
    group: str = ""
    #: The sort of error, of those that are made by rule; some of each sort are drawn.
    sort: str = ""

    @property
    def digest(self) -> str:
        """Of what is changed to what: the same mutant in another run."""
        return hashlib.sha256(
            repr((self.kind, self.name, self.file, self.old, self.new, self.text)).encode()
        ).hexdigest()


@dataclass(frozen=True)
class Outcome:
    """``killer``: which check, and what it said. ``crash``: it ended otherwise."""

    mutant: Mutant
    killer: str = ""
    said: str = ""
    crash: str = ""
    seconds: float = 0.0

    @property
    def fate(self) -> str:
        if self.mutant.equivalent:
            return "equivalent"
        return "killed" if self.killer else "crashed" if self.crash else "survived"


def mutated_source(mutant: Mutant) -> str:
    """The source file's text with the change in it."""
    text = (ROOT / mutant.file).read_text(encoding="utf-8")
    if text.count(mutant.old) != 1:
        raise StaleMutantError(
            f"mutant '{mutant.name}': '{mutant.old}' stands {text.count(mutant.old)} times in {mutant.file}, not once."
        )
    return text.replace(mutant.old, mutant.new)


class _Overlay(importlib.machinery.SourceFileLoader):
    """Loads one module from a text in the place of its file."""

    def __init__(self, name: str, path: str, text: str) -> None:
        super().__init__(name, path)
        self.text = text

    def get_code(self, fullname: str) -> CodeType:
        return compile(self.text, self.path, "exec", dont_inherit=True)


class _Finder:
    def __init__(self, name: str, path: Path, text: str) -> None:
        self.name, self.path, self.text = name, path, text

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if name != self.name:
            return None
        places = [str(self.path.parent)] if self.path.name == "__init__.py" else None
        return importlib.util.spec_from_file_location(
            name, self.path, loader=_Overlay(name, str(self.path), self.text), submodule_search_locations=places
        )


def overlay(mutant: Mutant) -> str:
    """From now on this process imports the mutated module, whose name is returned; of a template its reader's."""
    if mutant.file.endswith(".j2"):
        return _overlay_template(Path(mutant.file).name, mutated_source(mutant))
    name = mutant.file.removesuffix(".py").replace("/", ".").removesuffix(".__init__")
    assert name not in sys.modules, f"{name} was imported before it could be mutated"
    sys.meta_path.insert(0, _Finder(name, ROOT / mutant.file, mutated_source(mutant)))  # type: ignore[arg-type]
    return name


def _overlay_template(template: str, text: str) -> str:
    """From now on this process fills in the mutated template."""
    import jinja2

    read = jinja2.FileSystemLoader.get_source

    def get_source(self: Any, environment: Any, name: str) -> Any:
        return (text, None, lambda: True) if name == template else read(self, environment, name)

    jinja2.FileSystemLoader.get_source = get_source  # type: ignore[method-assign]
    return "codegen.render.filter"
