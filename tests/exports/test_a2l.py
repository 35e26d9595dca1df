"""The calibration description: every number of the struct, at the place where a compiler has it."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from runtime.estimator.compiler import find_compiler
from runtime.exports.a2l import DATA_MODELS, a2l_text, drive_struct, leaves, read_address
from runtime.exports.variables import FIXED, TUNABLE, variables
from runtime.firmware.tools import find_tool
from runtime.system.errors import UserError
from tests.conftest import ALL_DRIVES
from tests.exports.drives import folder_of

#: A C28x's struct on the host: its int has half the size of its float, as the host's short has, in units of a short.
_SHORT = "#define PMSM_PORT_H\ntypedef float float32;\n#define int short\n"

_ENTRY = re.compile(r"/begin (MEASUREMENT|CHARACTERISTIC) (\S+) \"([^\"]*)\"(.*?)/end \1", re.DOTALL)


def entries(text: str) -> dict[str, tuple[str, int, int, str]]:
    """Kind, address, offset of the symbol link and type of every entry, by its name without the symbol's."""
    found = {}
    for kind, name, _, body in _ENTRY.findall(text):
        address = int(re.search(r"0x([0-9A-F]+)", body)[1], 16)  # type: ignore[index]
        offset = int(re.search(r'SYMBOL_LINK "\w+" (\d+)', body)[1])  # type: ignore[index]
        found[name.partition(".")[2]] = (kind, address, offset, body.split()[0])
    return found


def offsets(
    drive: str, kind: str, places: list[str], compiler: list[str], head: str, unit: int, folder: Path
) -> list[int]:
    """Where a compiler has them: read from an array of its assembly."""
    generated = folder_of(drive)
    for path in generated.path.glob("*.h"):
        (folder / path.name).write_text(path.read_text("utf-8"), encoding="utf-8")
    prefix = f"{drive}_{kind}_drive"
    numbers = ",\n".join(f"offsetof({prefix}_t, {place})" for place in places)
    text = f'#include <stddef.h>\n{head}#include "{prefix}.h"\n#undef int\nconst unsigned found[] = {{ {numbers} }};\n'
    (folder / "offsets.c").write_text(text, encoding="utf-8")
    command = [*compiler, "-S", "-O1", "-o", "-", "offsets.c"]
    assembly = subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True).stdout
    read = []
    for line in assembly.partition("found:")[2].splitlines():
        words = line.split()
        if words and words[0] in {".word", ".long"}:
            read.append(int(words[1]) // unit)
        elif words and words[0] in {".zero", ".space"}:
            read += [0] * (int(words[1]) // 4)
    return read[: len(places)]


@pytest.mark.parametrize("drive", ALL_DRIVES)
def test_places_are_the_compilers(drive: str, tmp_path: Path) -> None:
    generated = folder_of(drive)
    kind = generated.chosen(None)
    struct = drive_struct(generated, kind)
    cases = {
        "ilp32": ([find_tool("arm-none-eabi-gcc"), "-mcpu=cortex-m4"], "", 1),
        "c28x": (find_compiler(), _SHORT, 2),
    }
    for model, (compiler, head, unit) in cases.items():
        ours = list(leaves(struct, DATA_MODELS[model]))
        places = [leaf.place for leaf in ours]
        assert len(places) == len(set(places)) > 100
        assert [leaf.offset for leaf in ours] == offsets(drive, kind, places, compiler, head, unit, tmp_path)


def test_tuning_is_to_be_set_and_the_rest_to_be_measured() -> None:
    folder = folder_of("ipmsm")
    found = entries(a2l_text(folder, "ickf", "ilp32", "my_drive", 0x20001000))
    tuned = {
        entry.place.removeprefix("drive.")
        for entry in variables(folder, "drive")
        if entry.role in {TUNABLE, FIXED} and entry.name != "delay"
    }
    assert {place for place, (kind, *_) in found.items() if kind == "CHARACTERISTIC"} == tuned | {"injection[0]"}
    assert set(found) == {leaf.place for leaf in leaves(drive_struct(folder, "ickf"), DATA_MODELS["ilp32"])}
    for _, address, offset, _ in found.values():
        assert address == 0x20001000 + offset
    assert found["supervisor.mode"][3] == "SLONG"
    assert entries(a2l_text(folder, "ickf", "c28x", "d", 0))["supervisor.mode"][3] == "SWORD"


def test_the_wave_and_the_resistance_have_their_units() -> None:
    text = a2l_text(folder_of("ipmsm"), "ickf", "ilp32", "my_drive", 0)
    assert 'CHARACTERISTIC my_drive.injection[0] "injection: amplitude of the square wave, 0: none"' in text
    resistance = text[text.index("MEASUREMENT my_drive.resistance[0]") :]
    assert "as_ohm" in resistance[: resistance.index("/end MEASUREMENT")]
    assert "injection" not in a2l_text(folder_of("paper_spmsm"), "ickf", "ilp32", "my_drive", 0)


def test_what_is_refused() -> None:
    folder = folder_of("ipmsm")
    with pytest.raises(UserError, match="data model"):
        a2l_text(folder, "ickf", "lp64", "drive", 0)
    with pytest.raises(UserError, match="name of a variable"):
        a2l_text(folder, "ickf", "c28x", "my drive", 0)
    assert (read_address("0x20"), read_address("32"), read_address("0xFFFFFFFF")) == (32, 32, 0xFFFFFFFF)
    for text in ("-1", "0x100000000", "here", ""):
        with pytest.raises(UserError, match="address"):
            read_address(text)
