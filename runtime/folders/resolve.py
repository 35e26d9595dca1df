"""Which generated folder a DRIVE on the command line means."""

from __future__ import annotations

from pathlib import Path

from model.drives.load import load_drive
from runtime.estimator.folder import GENERATED, GeneratedFolder, find_folder
from runtime.folders.stated import machine_text, stated_drive
from runtime.system.errors import UserError


def drive_folder(name: str) -> GeneratedFolder:
    """A shipped name, the path of a generated folder, or of a TOML file that was generated into ./generated.

    Raises
    ------
    UserError
        There is none, or the TOML file changed after it was generated.
    """
    if Path(name).suffix != ".toml":
        folder = find_folder(name)
        stated_drive(folder)
        return folder
    drive = load_drive(name)
    for place in (Path("generated"), GENERATED):
        if (place / drive.name / "manifest.json").is_file():
            folder = GeneratedFolder(place / drive.name)
            stated_drive(folder)
            stated, parameters = drive.model_dump(mode="json"), folder.manifest["parameters"]
            changed = any(stated[section] != values for section, values in parameters.items())
            if changed or machine_text(folder) != drive.machine_text:
                raise UserError(f"'{folder.path}' is stale: '{name}' says otherwise. Run: pmsm-ickf generate {name}")
            return folder
    raise UserError(f"drive '{name}' is not generated yet. Run: pmsm-ickf generate {name}")
