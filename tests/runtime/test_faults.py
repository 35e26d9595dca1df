"""Faults of the machine around the commands, with real processes: killed, full, read-only."""

from __future__ import annotations

import os
import random
import resource
import shutil
import stat
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from codegen.output.folder import difference, edited_files, with_manifest
from runtime.estimator.folder import GENERATED
from runtime.system.errors import UserError
from runtime.system.files import whole_file, write_text
from tests.conftest import thoroughly
from tests.runtime.processes import PAPER, ROOT, call, finish, refused, start

# --- killed ---

#: Writes three folders over and over, from two sets of files by turns.
WRITER = """
import sys, itertools
from pathlib import Path
from codegen.output.folder import with_manifest, write_folder
def files(mark):
    return with_manifest({f"{k}.c": mark * 20_000 for k in range(20)}, {"drive": "x", "filters": {}})
print("ready", flush=True)
for mark in itertools.cycle(sys.argv[1]):
    for name in ("x", "y", "z"):
        write_folder(Path(name), files(mark), force=False)
"""


def files_of(mark: str) -> dict[str, str]:
    return with_manifest({f"{k}.c": mark * 20_000 for k in range(20)}, {"drive": "x", "filters": {}})


def whole(folder: Path, marks: str) -> bool:
    return any(difference(folder, files_of(mark)) == "" for mark in marks)


@pytest.mark.slow
@pytest.mark.parametrize("kills", [15, *thoroughly(40)])
def test_a_folder_is_the_old_or_the_new_one_whenever_its_writer_is_killed(kills: int, tmp_path: Path) -> None:
    chance = random.Random(1)
    seen = set()
    for _ in range(kills):
        process = start("-c", WRITER, "ab", cwd=tmp_path)
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(chance.uniform(0.0, 0.08))
        process.kill()
        process.communicate()
        for name in ("x", "y", "z"):
            if (tmp_path / name).exists():
                assert whole(tmp_path / name, "ab"), name
        left = [path.name for path in tmp_path.iterdir() if path.name.startswith(".")]
        assert len(left) <= 3, "what was left is removed when its folder is next written"
        seen |= {bool(left)}
    assert seen == {False, True} or seen == {True}, "some kills hit a write"


@pytest.mark.slow
def test_two_writers_at_once_leave_no_mixture(tmp_path: Path) -> None:
    writers = [start("-c", WRITER, mark, cwd=tmp_path) for mark in ("a", "b", "ba")]
    try:
        for writer in writers:
            assert writer.stdout is not None
            writer.stdout.readline()
        for _ in range(60):
            for name in ("x", "y", "z"):
                if (tmp_path / name).exists():
                    assert edited_files(tmp_path / name) == [], "files and manifest are one writer's"
        assert all(writer.poll() is None for writer in writers), "none was refused or failed"
    finally:
        for writer in writers:
            writer.kill()
            writer.communicate()


@pytest.mark.thorough
def test_generate_killed_while_it_writes_two_drives(tmp_path: Path) -> None:
    """Old folders are exchanged for new ones; a kill leaves each either, and the next run ends well."""
    chance = random.Random(2)
    drives = ("first", "second")

    def state(resistance: str) -> None:
        for name in drives:
            text = PAPER.replace("paper_spmsm", name).replace("2.875", resistance)
            (tmp_path / f"{name}.toml").write_text(text, encoding="utf-8")

    words = ("generate", "first.toml", "second.toml")
    expected: dict[str, list[dict[str, bytes]]] = {name: [] for name in drives}

    def contents(name: str) -> dict[str, bytes]:
        folder = tmp_path / "generated" / name
        return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}

    values = ("1.2", "1.3")
    for value in values:
        state(value)
        assert call(*words, cwd=tmp_path)[0] == 0
        for name in drives:
            expected[name].append(contents(name))
    state(values[0])
    process = start("-m", "runtime", *words, cwd=tmp_path)
    assert process.stdout is not None
    for line in process.stdout:
        if "writing" in line:
            break
    time.sleep(chance.uniform(0.0, 0.02))
    process.kill()
    process.communicate()
    for name in drives:
        assert contents(name) in expected[name]
    assert call(*words, cwd=tmp_path)[0] == 0
    assert [contents(name) for name in drives] == [expected[name][0] for name in drives]


# --- full, read-only ---


def may_mount() -> bool:
    return shutil.which("unshare") is not None and not subprocess.run(
        ["unshare", "-rm", "mount", "-t", "tmpfs", "none", "/mnt"], capture_output=True, check=False
    ).returncode  # fmt: skip


needs_mount = pytest.mark.skipif(not may_mount(), reason="this machine does not let us mount (unshare -rm)")


def mounted(tmp_path: Path, script: str) -> subprocess.CompletedProcess[str]:
    """A shell script in which ``$GENERATE`` is the command; what it mounts is gone afterwards."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "GENERATE": f"{sys.executable} -m runtime generate"}
    return subprocess.run(
        ["unshare", "-rm", "sh", "-ec", script], cwd=tmp_path, env=environment, capture_output=True, text=True,
        check=False,
    )  # fmt: skip


@pytest.mark.thorough
@needs_mount
def test_a_full_disk_leaves_the_old_folder(tmp_path: Path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "mine.toml").write_text(PAPER.replace("paper_spmsm", "mine"))
    (tmp_path / "other.toml").write_text(PAPER.replace("paper_spmsm", "mine").replace("2.875", "1.2"))
    script = """
        mount -t tmpfs -o size=1m none full
        $GENERATE mine.toml --out full >&2
        head -c 2m /dev/zero > full/filler 2>/dev/null || true
        $GENERATE other.toml --out full && exit 99 || test $? = 2
        rm full/filler
        $GENERATE mine.toml --out full --check
        ls -A full
        """
    done = mounted(tmp_path, script)
    assert done.returncode == 0, done.stderr
    assert "No space left on device; it is left as it was." in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout.split()[-1] == "mine"


@needs_mount
def test_a_read_only_disk_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "fixed").mkdir()
    script = """
        mount -t tmpfs -o ro none fixed
        $GENERATE paper_spmsm --out fixed && exit 99 || test $? = 2
        """
    done = mounted(tmp_path, script)
    assert done.returncode == 0, done.stderr
    assert done.stderr.splitlines()[-1] == ("pmsm-ickf: --out 'fixed' cannot be written to: a read-only file system.")
    assert "Traceback" not in done.stderr


def limited(size: int) -> Callable[[], None]:
    """No file may be larger, in bytes."""
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


@pytest.mark.parametrize("limit", [1000, *thoroughly(0, 30_000)])
def test_a_file_size_limit_leaves_the_old_folder(tmp_path: Path, limit: int) -> None:
    shutil.copytree(GENERATED / "paper_spmsm", tmp_path / "out" / "mine")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    (tmp_path / "mine.toml").write_text(PAPER.replace("paper_spmsm", "mine"))
    words = ("-m", "runtime", "generate", "mine.toml", "--out", "out", "--force")
    process = start(*words, cwd=tmp_path, preexec_fn=limited(limit), environment={"PATH": "/nowhere"})
    line = refused(finish(process))
    assert line == "pmsm-ickf: cannot write 'out/mine': File too large; it is left as it was."
    (tmp_path / "mine.toml").unlink()
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_results_that_do_not_fit_leave_the_old_file(tmp_path: Path) -> None:
    data = str(ROOT / "tests" / "data" / "spmsm_step.npz")
    (tmp_path / "f.npz").write_bytes(b"old")
    (tmp_path / "f.json").write_bytes(b"old")
    for option, name in (("--out", "f.npz"), ("--json", "f.json")):
        words = ("-m", "runtime", "replay", "spmsm_load_torque", data, "--backend", "numpy", option, name)
        line = refused(finish(start(*words, cwd=tmp_path, preexec_fn=limited(200))))
        assert line == f"pmsm-ickf: cannot write '{name}': File too large."
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"f.npz": b"old", "f.json": b"old"}


def test_a_file_is_the_old_one_until_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "f.json"
    write_text(path, "old")

    def broken() -> None:
        with whole_file(path) as file:
            file.write(b"new, but")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        broken()
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["f.json"]
    write_text(path, "new")
    assert path.read_text() == "new"
    (tmp_path / "link").symlink_to(path)
    write_text(tmp_path / "link", "through the link")
    assert (path.read_text(), (tmp_path / "link").is_symlink()) == ("through the link", True)
    write_text(Path("/dev/null"), "gone")
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode), "a device is not replaced"
    for bad in (tmp_path, path / "below", tmp_path / "no" / "folder", tmp_path / ("x" * 300)):
        with pytest.raises(UserError, match="cannot write"):
            write_text(bad, "x")


# --- names ---


@pytest.mark.parametrize(
    ("name", "locale"),
    [
        ("a blank and a quote'\"$(x) 电机", "C.UTF-8"),
        (os.fsdecode(b"\xff\xfe"), "POSIX"),
        *thoroughly(("Müller Größe 电机", "C.UTF-8"), ("Müller Größe 电机", "POSIX")),
    ],
)
def test_blanks_and_other_letters_in_every_path(name: str, locale: str, tmp_path: Path) -> None:
    place = tmp_path / name
    place.mkdir()
    (place / f"{name}.toml").write_text(PAPER.replace("paper_spmsm", "mine"), encoding="utf-8")
    shutil.copy(GENERATED.parent / "tests" / "data" / "spmsm_step.npz", place / f"{name}.npz")
    home = {"HOME": str(place), "PMSM_ICKF_CACHE": "", "LC_ALL": locale, "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}
    run: Callable[..., tuple[int, str, str]] = lambda *words: call(*words, cwd=place, environment=home)  # noqa: E731
    code, _, err = run("generate", f"{name}.toml", "--out", f"{name} out")
    assert code == 0, err
    words = ("replay", "spmsm_load_torque", f"{name}.npz", "--out", f"{name} e.npz", "--json", f"{name}.json")
    code, _, err = run(*words)
    assert code == 0, err
    assert (place / f"{name} e.npz").is_file()
    assert any((place / ".cache" / "pmsm-ickf").iterdir())
    (place / f"{name}.toml").write_text("[motor")
    refused(run("generate", f"{name}.toml"))
