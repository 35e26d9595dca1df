"""Write generated folders: every drive in memory first, so that a bad one leaves all folders as they were."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from codegen.evidence.budget import Account, check_budget, late
from codegen.evidence.measure import Measurer, kept_records
from codegen.generate import FORMS, generate
from codegen.ir.graph import UnsupportedOperationError
from codegen.output.folder import MANIFEST, difference, write_folder
from codegen.targets.find import find_target
from model.drives.load import shipped_drives
from model.schema import Drive, DriveError, TargetChoice
from runtime.estimator.folder import GENERATED
from runtime.folders.resolve import NamedDrive, find_drive, target_folder
from runtime.system.collector import leave_circles
from runtime.system.errors import UserError
from runtime.system.values import read_word
from runtime.system.workers import workers

Progress = Callable[[str], None]

#: Drives whose circles may lie about in one process: 30 MB each, of the shipped ones.
DRIVES_AT_ONCE = 10


@dataclass(frozen=True)
class Written:
    """One drive's outcome: ``state`` is new, updated, unchanged or stale; ``diff`` what changed.

    ``remark``: what the user should know of it; else empty.
    """

    drive: str
    folder: Path
    state: str
    files: int
    diff: str
    remark: str = ""


def generate_drives(
    drives: Sequence[str],
    out: Path | None,
    check: bool = False,
    force: bool = False,
    form: str = "fast",
    progress: Progress = lambda text: None,
    target: str | None = None,
    constant_time: bool = False,
) -> list[Written]:
    """Generate every drive in memory first, then write: a bad one leaves all folders as they were.

    With ``check`` nothing is written.

    Parameters
    ----------
    drives : sequence of str
        Shipped names, TOML files or generated folders; none: every shipped drive.
    out : Path or None
        Where files are written; None: the default place.
    check : bool, optional
        Compare only; write nothing.
    force : bool, optional
        Overwrite a folder that was edited by hand.
    form : str, optional
        "fast" (what is shipped) or "literal" (the paper's shape).
    progress : Progress, optional
        Told how far the work is.
    target : str, optional
        The processor to generate for, in the place of the drive files'.
    constant_time : bool, optional
        In constant time, also where a drive file does not ask for it.
    """
    read_word(form, "form", FORMS)
    if out is None:
        _refuse_to_replace(form, {"--target": target is not None, "--constant-time": constant_time})
    chosen = [find_drive(word) for word in drives or shipped_drives()]
    if target is not None:
        find_target(target)
    if target is not None or constant_time:
        chosen = [replace(named, drive=for_target(named.drive, target, constant_time)) for named in chosen]
    names = [named.drive.name for named in chosen]
    for name in names:
        if names.count(name) > 1:
            raise DriveError(f"two drives are called '{name}'; each needs a name of its own.")
    folders = [target_folder(named, out) for named in chosen]
    packages = _generate_all(chosen, out, check, form, progress)
    results = []
    for folder, named, package in zip(folders, chosen, packages, strict=True):
        diff = difference(folder, package.files)
        state = "unchanged" if not diff else "stale" if check else "updated" if (folder / MANIFEST).is_file() else "new"
        if diff and not check:
            if folder.parent == GENERATED and not (GENERATED.parent / "pyproject.toml").is_file():
                raise UserError(f"'{folder}' is the installed package's and stays as it is: say where with --out DIR.")
            progress(f"{named.word}: writing")
            write_folder(folder, package.files, force)
        results.append(Written(package.name, folder, state, len(package.files), diff, package.remark))
    return results


def _refuse_to_replace(form: str, options: Mapping[str, bool]) -> None:
    """What is not what the drive file says goes where the user says."""
    for option, given in options.items():
        if given:
            raise UserError(f"{option} differs from what the drive file says: say where it goes with --out DIR.")
    if form != "fast":
        raise UserError("the literal form is for reading: say where it goes with --out DIR, beside the shipped one.")


def for_target(drive: Drive, target: str | None, constant_time: bool = False) -> Drive:
    """The same drive for another processor, or in constant time.

    Parameters
    ----------
    drive : Drive
    target : str or None
        Its name; None: the drive's own.
    constant_time : bool, optional
        Asked for; a drive that asks for it itself keeps it.
    """
    choice = TargetChoice(name=target or drive.target_name, constant_time=constant_time or drive.constant_time)
    return drive.model_copy(update={"target": choice})


@dataclass(frozen=True)
class InMemory:
    """A generated folder before it is one."""

    name: str
    files: dict[str, str]
    remark: str = ""


def _generate_all(
    drives: Sequence[NamedDrive], out: Path | None, check: bool, form: str, progress: Progress
) -> list[InMemory]:
    """Several drives at once where there are cores."""
    count = min(len(drives), os.cpu_count() or 1)
    if count == 1:
        progress(f"{drives[0].word}: generating")
        return [_generate(drive, out, check, form) for drive in drives]
    with workers(count) as submit:
        futures = [submit(_generate, drive, out, check, form) for drive in drives]
        results = []
        for drive, future in zip(drives, futures, strict=True):
            progress(f"{drive.word}: generating")
            results.append(future.result())
        return results


def _generate(named: NamedDrive, out: Path | None, check: bool, form: str) -> InMemory:
    """One drive in memory, within its budget; stack and code size as the folder has them, else measured."""
    leave_circles(DRIVES_AT_ONCE)
    drive = named.drive
    kept = kept_records(target_folder(named, out))
    try:
        package = generate(drive, measurer=Measurer(kept, compile=True, retry=not check), form=form)
    except UnsupportedOperationError as error:
        raise UserError(f"drive '{drive.name}': {error}") from None
    if form == "fast":  # the literal form is for reading and proving, not for the chip
        check_budget(drive, package.accounts)
    return InMemory(package.drive.name, package.files, _too_long(drive, package.accounts))


def _too_long(drive: Drive, accounts: Mapping[str, Account]) -> str:
    """What takes longer than the sample time on the target, in one line; empty where nothing does."""
    shares = late(drive, accounts)
    if not shares:
        return ""
    said = ", ".join(f"{what} {100 * part:.0f} %" for what, part in shares.items())
    return (
        f"drive '{drive.name}': longer than its sample time on the {find_target(drive.target_name).title}, at the "
        f"worst and by an estimate from published cycles: {said}. REPORT.md, Budget, says what helps."
    )
