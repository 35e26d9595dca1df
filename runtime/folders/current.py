"""Is a generated folder there, unedited, and what the generator would write now?"""

from __future__ import annotations

from pathlib import Path

from codegen.evidence.measure import Measurer, kept_records
from codegen.generate import Package, generate
from codegen.output.folder import FolderError, check_unedited, difference
from model.drives.load import load_drive
from model.schema import Drive
from runtime.estimator.compiler import find_compiler
from runtime.estimator.folder import GENERATED
from runtime.system.errors import UserError


def check_ready(drive: str | Path) -> None:
    """Raise UserError for what is seen at a glance: done for all drives before the first is proved.

    No compiler, a wrong drive file, no folder, or one edited by hand. Whether it is stale takes a generation:
    :func:`current_package`.
    """
    find_compiler()
    load_drive(drive)
    _check_unedited(generated_folder(drive))


def current_package(drive: Drive, path: Path) -> Package:
    """Generate a drive in memory; UserError where its folder is missing, edited by hand or stale."""
    _check_unedited(path)
    package = generate(drive, measurer=Measurer(kept_records(path)))
    if difference(path, package.files):
        raise UserError(
            f"'{path}' is stale: the drive file or the generator changed since. Run: pmsm-ickf generate {drive.name}"
        )
    return package


def generated_folder(drive: str | Path) -> Path:
    """Where a drive's generated folder is looked for: the project's for shipped names, ./generated for TOML files."""
    return GENERATED / str(drive) if Path(drive).suffix != ".toml" else Path("generated") / load_drive(drive).name


def _check_unedited(path: Path) -> None:
    if not path.is_dir():
        raise UserError(f"no generated folder '{path}'. Run: pmsm-ickf generate {path.name}")
    try:
        check_unedited(path)
    except FolderError as error:
        raise UserError(str(error)) from None
