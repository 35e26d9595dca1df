"""A part as one C file: the generated sources one after the other, the part around them, and its table of variables."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from runtime.drive.interface import POWERED_MOTOR
from runtime.drive.motor import inverter_of, longest_step
from runtime.drive.simulation import RANGE_SHARE
from runtime.estimator.folder import GeneratedFolder
from runtime.exports.variables import Variable

_OWN = Path(__file__).parent
_INCLUDE = re.compile(r'^#include "(?P<name>[^"]+)"\n', re.MULTILINE)
#: Names at file scope that two sources may both have.
_STATIC = re.compile(r"^static [\w ]*?\*?(?P<name>\w+)(?=\(|\[| =)", re.MULTILINE)
_MACRO = re.compile(r"^#define (?P<name>\w+)", re.MULTILINE)

_TYPES = {"float32": "FLOAT32", "float64": "FLOAT64", "int": "INT32"}

_TABLE = """\
/* --- the part's variables: their place in its list is their reference ---------------------------------------- */

typedef enum { FLOAT32, FLOAT64, INT32 } type_t;
typedef enum { INPUT, OUTPUT, TUNABLE, FIXED } role_t;

typedef struct {
    type_t type;
    role_t role;
    size_t offset; /* bytes, of part_t */
} variable_t;

"""


def one_file(sources: Mapping[str, str], order: Sequence[str]) -> str:
    """C sources as one: headers where they are first wanted, names of one source's own kept apart.

    Parameters
    ----------
    sources : mapping of str to str
        Texts by file name.
    order : sequence of str
        The ``.c`` files, in order.
    """
    done: set[str] = set()

    def included(name: str) -> str:
        if name in done or name not in sources:
            return ""
        done.add(name)
        return _INCLUDE.sub(lambda found: included(found["name"]), sources[name])

    texts = []
    for name in order:
        text = sources[name]
        headers = "".join(included(found) for found in _INCLUDE.findall(text))
        body = _INCLUDE.sub("", text)
        own, tag = dict.fromkeys(_STATIC.findall(body)), name.removesuffix(".c")
        apart = "".join(f"#define {word} {tag}_{word}\n" for word in own)
        together = "".join(f"#undef {word}\n" for word in dict.fromkeys([*own, *_MACRO.findall(body)]))
        texts += [headers, apart, body, together]
    return "".join(texts)


def part_text(folder: GeneratedFolder, kind: str, part: str, table: Sequence[Variable], inverter_delay: int = 0) -> str:
    """The C of a part: ``part_t``, ``part_init``, ``part_begin``, ``part_step``, SAMPLE_TIME, VARIABLES.

    Parameters
    ----------
    folder : GeneratedFolder
    kind : str
        Filter kind.
    part : {"filter", "drive", "motor"}
    table : sequence of Variable
        The part's.
    inverter_delay : {0, 1}
        Samples until the motor's inverter takes duty cycles, unless it is told: 0 where the exchange of values takes
        a sample already.
    """
    filter_name, plant = f"{folder.drive}_{kind}", f"{folder.drive}_plant"
    wanted = {
        "filter": [filter_name],
        "drive": [f"{filter_name}{end}" for end in ("", "_foc", "_supervisor", "_drive")],
        "motor": [plant],
    }[part]
    place = "host/" if part == "motor" else ""
    sources = {f"{name}{end}": folder.text(f"{place}{name}{end}") for name in wanted for end in (".h", ".c")}
    sources["pmsm_port.h"] = folder.text("pmsm_port.h")
    code = one_file(sources, [f"{name}.c" for name in wanted])
    names = {"FILTER": filter_name, "DRIVE": f"{filter_name}_drive"} if part != "motor" else {"PLANT": plant}
    text = [
        "#include <stddef.h>\n#include <string.h>\n\n",
        "" if part != "motor" else sources["pmsm_port.h"],
        code,
        "\n#ifndef JOIN\n#define JOIN_(a, b) a##b\n#define JOIN(a, b) JOIN_(a, b)\n#endif\n" if part != "motor" else "",
        "".join(
            f"#define {name} {value}\n"
            for name, value in {**names, **_numbers(folder, part), "INVERTER_DELAY": str(inverter_delay)}.items()
        ),
        _without_includes(POWERED_MOTOR.read_text(encoding="utf-8")) if part == "motor" else "",
        "\n",
        (_OWN / "parts" / f"{part}.h").read_text(encoding="utf-8"),
        "\n",
        _TABLE,
        f"#define VARIABLE_COUNT {len(table)}u\n\nstatic const variable_t VARIABLES[VARIABLE_COUNT] = {{\n",
        "".join(
            f"    {{{_TYPES[entry.type]}, {entry.role.upper()}, offsetof(part_t, {entry.place})}}, /* {entry.name} */\n"
            for entry in table
        ),
        "};\n\n",
    ]
    return "".join(text)


def _without_includes(text: str) -> str:
    return text.replace("#include HEADER_PLANT\n", "")


def _numbers(folder: GeneratedFolder, part: str) -> dict[str, str]:
    """What the part's text asks for beside the generated sources."""
    stated = folder.manifest["parameters"]
    link = stated["control"]["dc_link"]
    numbers = {"SAMPLE_TIME": repr(float(folder.module.SAMPLE_TIME))}
    if part == "drive":
        numbers |= {"DC_LINK": f"{float(link)!r}f", "ADVANCE": str(folder.module.GAIN_NAMES.index("advance"))}
    if part == "motor":
        motor = stated["motor"]
        data = [
            motor[name]
            for name in ("stator_resistance", "inductance_d", "inductance_q", "magnet_flux", "inertia", "friction")
        ]
        dead_time, drop = inverter_of(stated)
        numbers |= {
            "MOTOR_DATA": "{" + ", ".join(repr(float(value)) for value in data) + "}",
            "SALIENT": str(int("per_L_q" in folder.manifest["plant"]["motor"])),
            "POLE_PAIRS_OF_MOTOR": str(motor["pole_pairs"]),
            "DC_LINK": repr(float(link)),
            "DEAD_TIME": repr(float(dead_time)),
            "SWITCH_DROP": repr(float(drop)),
            "SENSOR_RANGE": repr(float(RANGE_SHARE * stated["control"]["max_current"])),
            "LONGEST_STEP": repr(float(longest_step(folder))),
        }
    return numbers
