"""Packages: built from nothing where a toolchain is at hand, else checked for what they list."""

from __future__ import annotations

import configparser
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from runtime.cli import main
from runtime.commands.package import System
from runtime.estimator.folder import GENERATED, GeneratedFolder
from runtime.firmware.tools import find_tool
from runtime.packages.package import BUILD_SYSTEMS, generated_sources, package_files
from runtime.system.errors import UserError
from tests.conftest import ALL_DRIVES

HERE = Path(__file__).parent
M4 = ("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard")
P = "servo_24v_ckf"


def folder_of(name: str = "servo_24v") -> GeneratedFolder:
    return GeneratedFolder(GENERATED / name)


def written(place: Path, system: str, drive: str = "servo_24v") -> Path:
    folder = folder_of(drive)
    for name, text in package_files(folder, folder.chosen(None), system).items():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_text(text, encoding="utf-8")
    return place


def run(*command: str, where: Path) -> str:
    done = subprocess.run(command, cwd=where, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_command_offers_every_system() -> None:
    assert [system.value for system in System] == list(BUILD_SYSTEMS)


@pytest.mark.parametrize("system", BUILD_SYSTEMS)
def test_sources_are_the_generated_ones(system: str) -> None:
    for drive in ALL_DRIVES:
        folder = folder_of(drive)
        files = package_files(folder, folder.chosen(None), system)
        for name, text in generated_sources(folder, folder.chosen(None)).items():
            packed = files[f"src/{name}"]
            assert packed.endswith(text)
            assert (packed == text) == (name.endswith(".h") or not BUILD_SYSTEMS[system].pragma)
        assert str(Path.home()) not in "".join(files.values())
        assert not re.search(r"\{\{ [a-z]", "".join(files.values()))


@pytest.mark.slow
def test_cmake_builds_and_its_test_passes(tmp_path: Path) -> None:
    cmake, ctest = (find_python_tool(name) for name in ("cmake", "ctest"))
    place = written(tmp_path, "cmake")
    run(cmake, "-S", ".", "-B", "build", where=place)
    run(cmake, "--build", "build", where=place)
    assert "100% tests passed" in run(ctest, "--test-dir", "build", where=place)
    # The test can fail: with a constant that is a unit in the last place off.
    step = place / "src" / f"{P}.c"
    text = step.read_text("utf-8")
    broken = text.replace("#define GAIN_V 0.37693188f", "#define GAIN_V 0.37693185f")
    assert broken != text
    step.write_text(broken, encoding="utf-8")
    run(cmake, "--build", "build", where=place)
    assert subprocess.run([ctest, "--test-dir", "build"], cwd=place, capture_output=True, check=False).returncode != 0


@pytest.mark.slow
def test_cmake_within_another_project(tmp_path: Path) -> None:
    written(tmp_path / "drive", "cmake", "ipmsm")
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.16)\nproject(mine C)\nadd_subdirectory(drive)\n"
        "add_executable(mine mine.c)\ntarget_link_libraries(mine PRIVATE ipmsm_ickf)\n",
        encoding="utf-8",
    )
    (tmp_path / "mine.c").write_text(
        '#include "ipmsm_ickf_drive.h"\nstatic ipmsm_ickf_drive_t d;\n'
        "int main(void) { ipmsm_ickf_drive_init(&d, 1); return d.supervisor.inverter; }\n",
        encoding="utf-8",
    )
    cmake = find_python_tool("cmake")
    run(cmake, "-S", ".", "-B", "build", where=tmp_path)
    run(cmake, "--build", "build", where=tmp_path)
    run("build/mine", where=tmp_path)
    assert not (tmp_path / "build" / "drive" / "first").exists()


@pytest.mark.slow
def test_cmake_for_a_cortex_m4(tmp_path: Path) -> None:
    find_tool("arm-none-eabi-gcc")
    cmake = find_python_tool("cmake")
    place = written(tmp_path, "cmake")
    run(cmake, "-S", ".", "-B", "m4", "-DCMAKE_TOOLCHAIN_FILE=cortex-m4.cmake", where=place)
    run(cmake, "--build", "m4", where=place)
    assert "ARM" in run("arm-none-eabi-readelf", "-h", "m4/first", where=place)
    assert not FUSED.search(run("arm-none-eabi-objdump", "-d", "m4/first", where=place))


FUSED = re.compile(r"\bvfn?m[as]\b")


@pytest.mark.slow
def test_arduino_compiles_without_a_fused_operation(tmp_path: Path) -> None:
    """As a core compiles a library: no flag of ours. The pragma is what forbids fusing: without it GCC fuses."""
    place = written(tmp_path, "arduino")
    gcc, avr = find_tool("arm-none-eabi-gcc"), find_tool("avr-gcc")
    names = [path.name for path in (place / "src").glob("*.c")]
    assert len(names) == 6
    plain = [gcc, *M4, "-std=gnu11", "-O2", "-S", "-o", "-"]
    for name in names:
        assert not FUSED.search(run(*plain, f"src/{name}", where=place))
        run(avr, "-mmcu=atmega1284p", "-std=gnu11", "-Os", "-c", "-o", "/dev/null", f"src/{name}", where=place)
    text = (place / "src" / f"{P}.c").read_text("utf-8")
    (place / "src" / "bare.c").write_text(text[text.index("#endif\n") + 7 :], encoding="utf-8")
    assert FUSED.search(run(*plain, "src/bare.c", where=place))
    sketch = (place / "examples" / "First" / "First.ino").read_text("utf-8")
    (place / "first.cpp").write_text(f'#include "Arduino.h"\n{sketch}', encoding="utf-8")
    shutil.copy(HERE / "Arduino.h", place)
    run("g++", "-std=gnu++17", "-Wall", "-Werror", "-fsyntax-only", "-Isrc", "-I.", "first.cpp", where=place)


@pytest.mark.parametrize("system", BUILD_SYSTEMS)
def test_every_file_that_is_listed_is_there(system: str) -> None:
    """And every source is listed: by the build system's own file, read by its own format."""
    files = package_files(folder_of(), "ckf", system)
    sources = {name for name in files if name.startswith("src/") and name.endswith(".c")}
    example = {"example/main.c", "example/board.c", "example/drive_isr.c"}
    if system == "cmake":
        assert set(re.findall(r"src/\w+\.c", files["CMakeLists.txt"])) == sources
        assert set(re.findall(r"example/\w+\.c", files["CMakeLists.txt"])) == example
    elif system == "zephyr":
        module = dict(re.findall(r"^ *(\w+): (\S+)$", files["zephyr/module.yml"], re.MULTILINE))
        assert f"{module['cmake']}/CMakeLists.txt" in files
        assert module["kconfig"] in files
        assert {f"src/{name}" for name in re.findall(r"\.\./src/(\w+\.c)", files["zephyr/CMakeLists.txt"])} == sources
        assert {f"example/{name}" for name in re.findall(r"\w+\.c\b", files["example/CMakeLists.txt"])} == example
        symbol = re.search(r"^config (\w+)", files["zephyr/Kconfig"], re.MULTILINE)
        assert symbol
        assert f"CONFIG_{symbol[1]}" in files["zephyr/CMakeLists.txt"]
    elif system == "ccs":
        listed = {entry.get("path") for entry in ElementTree.fromstring(files[f"{P}.projectspec"]).iter("file")}
        assert listed == {name for name in files if name.startswith(("src/", "example/"))}
    elif system == "platformio":
        about = json.loads(files["library.json"])
        assert about["build"]["flags"] == ["-ffp-contract=off"]
        assert f"src/{about['headers']}" in files
        project = configparser.ConfigParser(strict=True)
        project.read_string(files["platformio.ini"])
        assert project["platformio"]["src_dir"] == "example"
        assert "-ffp-contract=off" in project["env"]["build_flags"]
    else:
        about = dict(line.split("=", 1) for line in files["library.properties"].splitlines())
        assert f"src/{about['includes']}" in files
        assert about["name"] == P
    if BUILD_SYSTEMS[system].interrupt:
        assert example <= set(files)


def find_python_tool(name: str) -> str:
    """A program that a package of the extra test brings."""
    found = shutil.which(name) or shutil.which(name, path=str(Path(sys.executable).parent))
    assert found, f"{name} is in the extra test"
    return found


def ended(*words: str) -> int:
    with pytest.raises(SystemExit) as end:
        main(["package", "servo_24v", "--for", "zephyr", "--out", *words])
    return int(end.value.code or 0)


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "mine"
    assert ended(str(out)) == 0
    assert "Not built here: Zephyr" in capsys.readouterr().out
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    assert ended(str(out)) == 0
    assert before == {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    (out / "example" / "board.c").write_text("/* mine */\n", encoding="utf-8")
    assert ended(str(out)) == 2
    assert "board.c" in capsys.readouterr().err
    assert (out / "example" / "board.c").read_text("utf-8") == "/* mine */\n"
    assert ended(str(out), "--force") == 0
    assert before == {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}


def test_an_unknown_system_is_said() -> None:
    with pytest.raises(UserError, match="there are: cmake, arduino"):
        package_files(folder_of(), "ckf", "make")
