"""Find a generated folder and read its files, checked against its manifest."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

from runtime.system.errors import UserError
from runtime.system.values import nearest

#: The generated drives that come with the project lie beside its packages.
GENERATED = Path(__file__).parents[2] / "generated"

#: Kinds of filters that can be generated.
KINDS = ("ckf", "ickf", "ekf", "ukf")

#: Keys of every manifest, and their types.
_MANIFEST = {"drive": str, "filters": dict, "files": dict, "parameters": dict, "states": list}


@dataclass(frozen=True)
class GeneratedFolder:
    """A folder written by ``pmsm-ickf generate``. With ``checked`` a file that was edited by hand is refused."""

    path: Path
    checked: bool = True

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """The folder's manifest.json, read once."""
        where = f"'{self.path}' is not a generated folder: manifest.json"
        try:
            manifest: dict[str, Any] = json.loads((self.path / "manifest.json").read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise UserError(f"{where} cannot be read ({error}).") from None
        for key, kind in _MANIFEST.items():
            if not isinstance(manifest, dict) or not isinstance(manifest.get(key), kind) or not manifest[key]:
                raise UserError(f"{where} has no '{key}'. Regenerate it.")
        for key in ("files", "parameters"):
            if not all(isinstance(entry, dict) for entry in manifest[key].values()):
                raise UserError(f"{where} is damaged in '{key}'. Regenerate it.")
        return manifest

    @property
    def drive(self) -> str:
        """The drive's name."""
        return str(self.manifest["drive"])

    @property
    def kinds(self) -> tuple[str, ...]:
        """The filter kinds that were generated, in the drive file's order."""
        return tuple(self.manifest["filters"])

    def require(self, kind: str) -> None:
        """Make sure that the folder has a filter of this kind.

        Parameters
        ----------
        kind : str
            ekf, ukf, ckf or ickf.

        Raises
        ------
        UserError
            The folder has no filter of this kind; the message lists those it has, and names the nearest one unless
            ``kind`` is a word for a filter that was left out.
        """
        if kind not in self.kinds:
            hint = "" if kind in KINDS else nearest(kind, self.kinds)
            raise UserError(f"drive '{self.drive}' has no filter '{kind}'; generated: {', '.join(self.kinds)}.{hint}")

    def chosen(self, kind: str | None) -> str:
        """The kind of filter that is asked for.

        Parameters
        ----------
        kind : str or None
            None: the ickf where there is one, else the first.

        Returns
        -------
        str

        Raises
        ------
        UserError
            The folder has no filter of this kind.
        """
        found = kind or ("ickf" if "ickf" in self.kinds else self.kinds[0])
        self.require(found)
        return found

    def text(self, name: str) -> str:
        """Read a file of the folder.

        Parameters
        ----------
        name : str
            Path relative to the folder.

        Raises
        ------
        UserError
            If it is missing, or differs from what was generated.
        """
        try:
            raw = (self.path / name).read_bytes()
        except OSError as error:
            raise UserError(f"'{self.path / name}' cannot be read: {error.strerror}. Regenerate the folder.") from None
        if self.checked and hashlib.sha256(raw).hexdigest() != self.manifest["files"].get(name, {}).get("sha256"):
            raise UserError(
                f"'{self.path / name}' was edited by hand (it differs from manifest.json). "
                "Put the change into the drive file and run: pmsm-ickf generate."
            )
        return raw.decode("utf-8")

    @cached_property
    def module(self) -> ModuleType:
        """The generated Python module, executed from the checked text."""
        name = f"{self.drive}.py"
        module = ModuleType(f"generated_{self.drive}")
        exec(_compiled(self.text(name), str(self.path / name)), module.__dict__)
        return module


@lru_cache(maxsize=16)
def _compiled(text: str, path: str) -> CodeType:
    """The code of a generated module, compiled once a process however often its folder is looked for."""
    return compile(text, path, "exec")


def find_folder(name: str | Path, checked: bool = True) -> GeneratedFolder:
    """Find a shipped drive's folder by name, or any generated folder by path.

    Parameters
    ----------
    name : str or Path
    checked : bool
        Compare files with the manifest's digests as they are read.

    Raises
    ------
    UserError
        If there is neither.
    """
    for path in (GENERATED / str(name), Path(name)):
        if (path / "manifest.json").is_file():
            return GeneratedFolder(path, checked)
    if Path(name).is_dir():
        raise UserError(f"'{name}' is not a generated folder: no manifest.json in it.")
    known = sorted(path.parent.name for path in GENERATED.glob("*/manifest.json"))
    hint = nearest(str(name), known)
    raise UserError(
        f"no generated drive '{name}': neither a shipped one ({', '.join(known) or 'none'}) nor a folder.{hint}"
    )
