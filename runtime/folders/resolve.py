"""The meaning of DRIVE on every command line: a shipped name, a TOML file, or a generated folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from model.drives.load import DRIVES, load_drive, shipped_drives, unknown_drive
from model.schema import Drive, DriveError
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.folders.stated import machine_text, stated_drive
from runtime.system.errors import UserError


@dataclass(frozen=True)
class NamedDrive:
    """A drive as it was asked for: ``word`` is what was written, ``path`` where its generated folder belongs.

    ``takes_over``: a drive file of one's own whose name and place are a shipped drive's.
    """

    word: str
    drive: Drive
    path: Path
    takes_over: bool = False

    @property
    def generated(self) -> bool:
        """Whether there is a folder at ``path``."""
        return (self.path / "manifest.json").is_file()

    @property
    def advice(self) -> str:
        """The command that writes the folder anew, and that is not refused itself."""
        if self.takes_over:
            return f"pmsm-ickf generate {self.word} --out DIR, and give DIR/{self.drive.name} as the drive"
        return f"pmsm-ickf generate {self.word}"


def find_drive(word: str | Path) -> NamedDrive:
    """Find what a word means; the folder of a TOML file is looked for, and belongs, under ./generated.

    Parameters
    ----------
    word : str or Path
        A shipped name, the path of a TOML file, or the path of a generated folder.

    Raises
    ------
    DriveError, UserError
        If it is none of the three, or one that cannot be read.
    """
    word = str(word)
    if word in shipped_drives():
        return NamedDrive(word, load_drive(word), GENERATED / word)
    if not word.endswith(".toml"):
        for path in (Path(word), GENERATED / word):
            if (path / "manifest.json").is_file():
                return NamedDrive(word, stated_drive(GeneratedFolder(path)), path)
        if Path(word).is_dir():
            raise UserError(f"'{word}' is not a generated folder: no manifest.json in it.")
        raise UserError(unknown_drive(word, "nor a TOML file, nor a generated folder"))
    drive = load_drive(word)
    if Path(word).resolve().parent == DRIVES.resolve():
        return NamedDrive(word, drive, GENERATED / drive.name)
    path = Path("generated") / drive.name
    takes_over = drive.name in shipped_drives() and path.resolve() == (GENERATED / drive.name).resolve()
    return NamedDrive(word, drive, path, takes_over)


def target_folder(named: NamedDrive, out: Path | None) -> Path:
    """Where ``generate`` writes: ``out``/name, else where the folder belongs.

    Parameters
    ----------
    named : NamedDrive
    out : Path or None
        Where files are written; None: the default place.

    Raises
    ------
    DriveError
        If a drive file of one's own would take the place of a shipped drive.
    """
    if out is not None:
        return out / named.drive.name
    if named.takes_over:
        raise DriveError(
            f"drive '{named.word}': the name '{named.drive.name}' belongs to a shipped drive; give yours its own, "
            "or use --out."
        )
    return named.path


def drive_folder(word: str | Path) -> GeneratedFolder:
    """Find the generated folder of a drive.

    Parameters
    ----------
    word : str or Path
        See :func:`find_drive`.

    Raises
    ------
    DriveError, UserError
        If there is none, or the TOML file changed after it was generated.
    """
    named = find_drive(word)
    if not named.generated:
        raise UserError(missing(named))
    folder = GeneratedFolder(named.path)
    if folder.manifest["parameters"] != named.drive.stated or machine_text(folder) != named.drive.machine_text:
        raise UserError(f"'{named.path}' is stale: '{named.word}' says otherwise. Run: {named.advice}")
    return folder


def missing(named: NamedDrive) -> str:
    """One line for a drive whose folder is not there."""
    return (
        f"drive '{named.word}' is not generated yet: no generated folder '{named.path}'. Run: {named.advice}; "
        "or give the folder that it was generated into."
    )
