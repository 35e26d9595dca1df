"""The drive a generated folder was made from, from what the folder itself holds."""

from __future__ import annotations

from model.drives.load import parse_drive
from model.machines.own import kept_as, read_word
from model.schema import Drive
from runtime.estimator.folder import GeneratedFolder


def stated_drive(folder: GeneratedFolder) -> Drive:
    """The drive as the folder was generated, whatever became of its files; DriveError if its manifest holds none."""
    parameters = {"name": folder.drive, **folder.manifest["parameters"]}
    return parse_drive(
        parameters, f"{folder.path.name}/manifest.json", folder.manifest.get("input_sha256", ""), machine_text(folder)
    )


def machine_text(folder: GeneratedFolder) -> str:
    """The machine file of one's own that the folder keeps; empty for a shipped machine."""
    word = read_word(folder.manifest["parameters"]["model"]["machine"])
    return folder.text(kept_as(word)) if word else ""
