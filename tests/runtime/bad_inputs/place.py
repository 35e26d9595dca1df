"""A folder of files that are wrong in every way, and what the tests of bad inputs ask of a command in it."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from typer.main import get_command

from model.drives.load import DRIVES
from runtime.cli import GROUPS, load_command
from runtime.design.facts import EXAMPLE
from runtime.design.write import facts_text
from runtime.estimator.folder import GENERATED

PAPER = (DRIVES / "paper_spmsm.toml").read_text(encoding="utf-8")
LOAD = (DRIVES / "spmsm_load_torque.toml").read_text(encoding="utf-8")
#: To Rich an end of a style that never began, and a style that is none; a line's end; a letter of no alphabet.
ODD = "a[/b]c[red]\nü\x1b"
#: One that is no UTF-8, as the operating system hands it over.
NO_UTF8 = "\udcff\udcfe"


def leaves(command: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every command of the command line: its words, and Typer's object for it."""
    for name in getattr(command, "commands", {}):  # which are loaded one by one
        yield from leaves(command.get_command(None, name), (*path, name))
    if not hasattr(command, "commands"):
        yield path, command


COMMANDS = {
    " ".join(path): command
    for word in chain(*GROUPS.values())
    for path, command in leaves(get_command(load_command(word)), (word,))
}

#: A machine file's text, and what the drive file calls it; each wrong in its own way.
MACHINES = {
    "raises": ("raise ValueError('[/red] no')", "raises.py:M"),
    "syntax": ("def", "syntax.py:M"),
    "leaves": ("import sys\nsys.exit(0)", "leaves.py:M"),
    "exhausts": ("def f():\n    return f()\nf()", "exhausts.py:M"),
    "lacks": ("x = 1", "lacks.py:M"),
    "number": ("M = 1", "number.py:M"),
    "plain": ("class M:\n    pass", "plain.py:M"),
    "abstract": ("from model.machines import Machine\nclass M(Machine):\n    pass", "abstract.py:M"),
    "imports": ("import no_such_module_anywhere", "imports.py:M"),
    "binary": ("\0\1\2", "binary.py:M"),
    "nowhere": ("", "no_such_file.py:M"),
    "word": ("", "surfase"),
    "noclass": ("", "number.py"),
    "escapes": ("", "../../../etc/passwd.py:M"),
}


def make_place(place: Path) -> None:
    """Fill a folder."""
    (place / "a_file").write_text("text\n")
    (place / "a_folder").mkdir()
    (place / "folder.toml").mkdir()
    _tomls(place)
    for name, (text, word) in MACHINES.items():
        (place / f"{name}.py").write_text(text)
        (place / f"machine_{name}.toml").write_text(
            PAPER.replace('"paper_spmsm"', f'"machine_{name}"').replace('machine = "surface"', f'machine = "{word}"')
        )
    _folders(place)
    _data(place)
    _facts(place)
    (place / "other.py").write_text(PAPER)


def _tomls(place: Path) -> None:
    raw = {
        "empty": b"", "binary": bytes(range(256)), "nul": PAPER.encode() + b"\0", "truncated": PAPER[:300].encode(),
        "latin1": PAPER.replace("paper", "päper").encode("latin-1"),
        "bare": b'name = "bare"\n', "tables": b"[[motor]]\n[[model]]\n", "numbers": b"motor = 1\nmodel = 2\n",
        "twice": PAPER.encode() + b"\n[motor]\n", "odd_name": PAPER.replace("paper_spmsm", "A b[/c]").encode(),
        "good": PAPER.replace("paper_spmsm", "good").encode(), "paper_again": PAPER.encode(),
        "tight": PAPER.replace('"paper_spmsm"', '"tight"').replace("\ncycles = 1500", "\ncycles = 500").encode(),
        ODD: PAPER.replace("2.875", "-2").encode(), "ns": PAPER.replace("20e-6", "20").encode(),
    }  # fmt: skip
    for name, content in raw.items():
        (place / f"{name}.toml").parent.mkdir(exist_ok=True)
        (place / f"{name}.toml").write_bytes(content)
    (place / "loop.toml").symlink_to("loop.toml")
    (place / "dangling.toml").symlink_to("nothing")
    (place / "eio.toml").symlink_to("/proc/self/mem")  # a disk that fails: the first page cannot be read


def _folders(place: Path) -> None:
    (place / "no_manifest").mkdir()
    for name, text in {"empty": "", "braces": "{}", "list": "[]", "cut": '{"drive": "x", ', "nan": "NaN"}.items():
        (place / f"manifest_{name}").mkdir()
        (place / f"manifest_{name}" / "manifest.json").write_text(text)
    for name in ("edited", "lacking", "renamed", "other_parameters", "no_filters"):
        shutil.copytree(GENERATED / "paper_spmsm", place / name)
    for path in (place / "edited").glob("**/paper_spmsm*.[chp]*"):
        path.write_text(path.read_text() + "\n")
    for path in (place / "lacking").glob("**/*.[chp]*"):
        path.unlink()
    (place / "renamed" / "paper_spmsm.py").rename(place / "renamed" / "other.py")
    _manifest(place / "other_parameters", parameters={"motor": {}, "model": {"machine": "surface"}})
    _manifest(place / "no_filters", filters={"pf": {}})


def _manifest(folder: Path, **changes: Any) -> None:
    path = folder / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def _data(place: Path) -> None:
    t = np.arange(5) * 20e-6
    good = {"t": t, "u_alpha": t, "u_beta": t, "i_alpha": t, "i_beta": t}
    changed = {
        "good": {}, "backwards": {"t": -t}, "still": {"t": 0 * t}, "timeless": {"t": np.nan * t},
        "strings": {"u_alpha": np.array(["a"] * 5)}, "shapes": {"i_beta": np.zeros((5, 2))},
        "short": {"i_beta": np.zeros(3)}, "complex": {"i_beta": 1j * t}, "slow": {"t": t * 1e6},
        "objects": {"u_beta": np.array([None] * 5)},
    }  # fmt: skip
    for name, change in changed.items():
        np.savez(place / f"{name}.npz", allow_pickle=True, **(good | change))
    np.savez(place / "lacks.npz", t=t, u_alpha=t)
    np.savez(place / "none.npz")
    np.savez(place / "rowless.npz", **{name: np.zeros(0) for name in good})
    np.savez(place / "hot.npz", **(good | {"i_alpha": np.full(5, np.nan), "i_beta": np.full(5, np.inf)}))
    whole = (place / "good.npz").read_bytes()
    rows = "t,u_alpha,u_beta,i_alpha,i_beta\n"
    raw = {
        "cut.npz": whole[: len(whole) // 2], "empty.npz": b"", "text.npz": b"text", "binary.csv": bytes(range(256)),
        "empty.csv": b"", "header.csv": rows.encode(), "one.csv": f"{rows}0,0,0,0,0\n".encode(), "words.csv": b"a b c",
        "uneven.csv": f"{rows}0,0,0,0,0\n2e-5,0\n4e-5,0,0,0,0\n".encode(), "nul.csv": f"{rows}0,0\0,0,0,0\n".encode(),
        "text.mat": b"text", "cut.mat": b"MATLAB 5.0 MAT-file".ljust(128) + b"\x0e\0\0\0\xff",
        "text.mf4": b"text", "cut.mf4": b"MDF     4.10    ", "data.xyz": b"\1\2", "data.json": b'{"t": [0, 1]}',
    }  # fmt: skip
    for name, content in raw.items():
        (place / name).write_bytes(content)
    for suffix in ("npz", "csv", "mat", "mf4"):
        (place / f"a_folder.{suffix}").mkdir()
    (place / "eio.csv").symlink_to("/proc/self/mem")


def _facts(place: Path) -> None:
    (place / "facts.toml").write_text(facts_text(EXAMPLE))
    (place / "facts_odd.toml").write_text(facts_text({**EXAMPLE, "name": "x"}).replace('"x"', '"[/b]"'))


def contents(place: Path) -> dict[str, str]:
    """Everything in a folder, by path: where a link leads, a file's size and when it was written."""
    found = {}
    for folder, folders, files in os.walk(place):
        for name in (*folders, *files):
            path = Path(folder) / name
            stat = path.lstat()
            what = (
                os.readlink(path)
                if path.is_symlink()
                else ""
                if path.is_dir()
                else f"{stat.st_size} {stat.st_mtime_ns}"
            )
            found[os.path.relpath(path, place)] = what
    return found
