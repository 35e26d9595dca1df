"""Whether a generated folder is there, unedited, and what the generator would write now."""

from __future__ import annotations

from pathlib import Path

from codegen.evidence.measure import Measurer, kept_records
from codegen.generate import Package, generate
from codegen.output.folder import FolderError, check_unedited, difference
from runtime.estimator.compiler import find_compiler
from runtime.folders.resolve import NamedDrive, find_drive, missing
from runtime.system.errors import UserError


def check_ready(drive: str | Path) -> None:
    """Raise UserError for what is seen at a glance: done for all drives before the first is proved.

    No compiler, a wrong drive file, no folder, or one edited by hand. Whether it is stale takes a generation:
    :func:`current_package`.

    Parameters
    ----------
    drive : str | Path
        A shipped name or the path of a TOML file.
    """
    try:
        find_compiler()
    except UserError as error:
        raise UserError(f"the proof executes the generated C (link D-E): {error}") from None
    _check_unedited(find_drive(drive))


def current_package(named: NamedDrive) -> Package:
    """Generate a drive in memory; UserError where its folder is missing, edited by hand or stale."""
    _check_unedited(named)
    package = generate(named.drive, measurer=Measurer(kept_records(named.path)))
    if difference(named.path, package.files):
        raise UserError(f"'{named.path}' is stale: the drive file or the generator changed since. Run: {named.advice}")
    return package


def _check_unedited(named: NamedDrive) -> None:
    if not named.path.is_dir():
        raise UserError(missing(named))
    try:
        check_unedited(named.path)
    except FolderError as error:
        raise UserError(str(error)) from None
