"""The templates of this package, and how they are filled."""

from __future__ import annotations

import pickle
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import jinja2
from jinja2.bccache import Bucket

from codegen.output.version import __version__

_TEMPLATES = Path(__file__).parent / "templates"
_SYNTAX: dict[str, Any] = {"trim_blocks": True, "lstrip_blocks": True, "keep_trailing_newline": True}


class _TemplateBytecode(jinja2.FileSystemBytecodeCache):
    """Compiled templates, kept beside them as Python keeps its modules': compiling took a tenth of a small drive.

    Their names hold all that compiling depends on but the template's text, which Jinja compares.
    """

    def __init__(self) -> None:
        syntax = "".join(f"{value:d}" for value in _SYNTAX.values())
        super().__init__(f"{_TEMPLATES / '__pycache__'}", f"%s.jinja-{jinja2.__version__}-{syntax}.bytecode")

    def load_bytecode(self, bucket: Bucket) -> None:
        """Read a template's bytecode; one that cannot be read is compiled."""
        try:
            super().load_bytecode(bucket)
        except (OSError, EOFError, pickle.UnpicklingError):
            bucket.reset()

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Write a template's bytecode, where Python would write a module's; a folder that cannot be written is left."""
        if not sys.dont_write_bytecode:
            with suppress(OSError):
                Path(self.directory).mkdir(exist_ok=True)
                super().dump_bytecode(bucket)


_ENVIRONMENT = jinja2.Environment(
    loader=jinja2.FileSystemLoader(_TEMPLATES),
    undefined=jinja2.StrictUndefined,
    bytecode_cache=_TemplateBytecode(),
    **_SYNTAX,
)


def render(template: str, **context: Any) -> str:
    """Fill a template of this package; an unknown name in it is an error.

    Parameters
    ----------
    template : str
        Its file, in ``templates/``.
    **context : Any
        What it names, by name.
    """
    return _ENVIRONMENT.get_template(template).render(version=__version__, **context)
