"""The drive's struct as an ASAP2 description (.a2l, 1.7.1): every number of it, to measure, and what is tuning, to set.

Addresses are a base and an offset within the struct. Calibration tools put the linked address in from the map file by
SYMBOL_LINK; where there is none, the base is given.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from codegen.output.version import __version__
from runtime.drive.interface import controller_declarations
from runtime.estimator.c_backend import c_sources
from runtime.estimator.folder import GeneratedFolder
from runtime.exports.variables import FIXED, INPUT, OUTPUT, TUNABLE, Variable, variables
from runtime.system.errors import UserError


@dataclass(frozen=True)
class DataModel:
    """Sizes in the units in which a processor counts addresses, and the range of its int."""

    int_size: int
    float_size: int
    int_type: str
    least: int
    most: int


#: The C28x counts words of 16 bits; the others count bytes.
DATA_MODELS = {
    "c28x": DataModel(1, 2, "SWORD", -32768, 32767),
    "ilp32": DataModel(4, 4, "SLONG", -2147483648, 2147483647),
}

_SINGLE_MAX = 3.4028235e38

#: What a drive that injects has beside the variables of other exports.
_WAVE = (
    Variable("injection", TUNABLE, "injection[0]", "V", "amplitude of the square wave, 0: none", "injection"),
    Variable("injection_sign", OUTPUT, "injection[1]", "", "that the wave has next", "injection"),
    Variable("resistance", OUTPUT, "resistance[0]", "ohm", "beyond the motor data, learnt from the wave", "resistance"),
)

#: Addresses have 32 bits.
_MOST_ADDRESS = 0xFFFFFFFF


def read_address(text: str) -> int:
    """An address such as ``0x20001000``.

    Parameters
    ----------
    text : str
        Hexadecimal with 0x, or decimal.

    Raises
    ------
    UserError
        No such number, or more than 32 bits.
    """
    try:
        found = int(text, 0)
    except ValueError:
        found = -1
    if not 0 <= found <= _MOST_ADDRESS:
        raise UserError(f"--address '{text}' is not an address such as 0x20001000.")
    return found


@dataclass(frozen=True)
class Leaf:
    """A number of a struct: the expression of it, whether it is an int, and its offset."""

    place: str
    integer: bool
    offset: int


def leaves(struct: Any, model: DataModel, place: str = "", offset: int = 0) -> Iterator[Leaf]:
    """Every number of a struct with the offset that it has on a processor.

    Parameters
    ----------
    struct : ctype
        cffi's, of a struct of int, float, arrays and structs.
    model : DataModel
    place : str
        Expression of the struct itself.
    offset : int
        Its own.
    """
    for name, field in struct.fields:
        kind = field.type
        offset = _aligned(offset, _alignment(kind, model))
        inner = f"{place}.{name}" if place else name
        count = kind.length if kind.kind == "array" else 1
        item = kind.item if kind.kind == "array" else kind
        for k in range(count):
            where = f"{inner}[{k}]" if kind.kind == "array" else inner
            if item.kind == "struct":
                yield from leaves(item, model, where, offset)
            else:
                yield Leaf(where, item.cname == "int", offset)
            offset += _size(item, model)


def _aligned(offset: int, alignment: int) -> int:
    return -(-offset // alignment) * alignment


def _alignment(kind: Any, model: DataModel) -> int:
    if kind.kind == "array":
        return _alignment(kind.item, model)
    if kind.kind == "struct":
        return max(_alignment(field.type, model) for _, field in kind.fields)
    return model.int_size if kind.cname == "int" else model.float_size


def _size(kind: Any, model: DataModel) -> int:
    if kind.kind == "array":
        return int(kind.length) * _size(kind.item, model)
    if kind.kind == "struct":
        end = 0
        for _, field in kind.fields:
            end = _aligned(end, _alignment(field.type, model)) + _size(field.type, model)
        return _aligned(end, _alignment(kind, model))
    return model.int_size if kind.cname == "int" else model.float_size


def drive_struct(folder: GeneratedFolder, kind: str) -> Any:
    """cffi's type of the drive's struct, from the generated headers.

    Parameters
    ----------
    folder : GeneratedFolder
    kind : str
        Filter kind.
    """
    import cffi

    prefix, sources = c_sources(folder, kind, "float32")
    foc = f"{prefix}_foc"
    sources |= {f"{foc}.h": folder.text(f"{foc}.h")}
    text = [controller_declarations(sources, prefix, foc)]
    for name in ("supervisor", "drive"):
        header = folder.text(f"{prefix}_{name}.h")
        start = header.index("typedef struct {")
        end = header.index(f"}} {prefix}_{name}_t;")
        text.append(header[start:end].replace("float32", "float") + f"}} {prefix}_{name}_t;")
    ffi = cffi.FFI()
    ffi.cdef("\n".join(line.partition("/*")[0] for line in "\n".join(text).splitlines()))
    return ffi.typeof(f"{prefix}_drive_t")


def a2l_text(folder: GeneratedFolder, kind: str, data_model: str, symbol: str, address: int) -> str:
    """The description's text.

    Parameters
    ----------
    folder : GeneratedFolder
    kind : str
        Filter kind.
    data_model : {"c28x", "ilp32"}
    symbol : str
        Name of the variable of type ``<p>_drive_t`` in the firmware.
    address : int
        Of that variable, in units of the processor; 0 where a tool puts it in.

    Raises
    ------
    UserError
        Another data model, or a symbol that is no C name.
    """
    model = DATA_MODELS.get(data_model)
    if model is None:
        raise UserError(f"no data model '{data_model}'; there are: {', '.join(DATA_MODELS)}.")
    if not (symbol.isidentifier() and symbol.isascii()):
        raise UserError(f"--symbol '{symbol}' is not the name of a variable in C.")
    known = {entry.place.removeprefix("drive."): entry for entry in variables(folder, "drive")}
    known |= {entry.place: entry for entry in _WAVE}
    entries = []
    units: dict[str, None] = {}
    for leaf in leaves(drive_struct(folder, kind), model):
        entry = known.get(leaf.place)
        unit = entry.unit if entry else ""
        words = f"{entry.name}: {entry.words}" if entry else leaf.place
        units[unit] = None
        tuned = entry is not None and entry.role in {TUNABLE, FIXED, INPUT}
        entries.append((_characteristic if tuned else _measurement)(leaf, model, symbol, address, unit, words))
    methods = [_method(unit) for unit in units]
    name = f"{folder.drive}_{kind}"
    return _FRAME.format(
        name=name,
        version=__version__,
        sha=folder.manifest["input_sha256"][:16],
        methods="\n".join(methods),
        entries="\n".join(entries),
        int_type=model.int_type,
    )


_FRAME = """\
ASAP2_VERSION 1 71
/begin PROJECT {name} "sensorless drive {name}"
  /begin HEADER "made by pmsm-ickf {version} from a drive file of sha256 {sha}"
  /end HEADER
  /begin MODULE {name}_module ""
    /begin MOD_COMMON ""
      BYTE_ORDER MSB_LAST
    /end MOD_COMMON
    /begin RECORD_LAYOUT one_float
      FNC_VALUES 1 FLOAT32_IEEE ROW_DIR DIRECT
    /end RECORD_LAYOUT
    /begin RECORD_LAYOUT one_int
      FNC_VALUES 1 {int_type} ROW_DIR DIRECT
    /end RECORD_LAYOUT
{methods}
{entries}
  /end MODULE
/end PROJECT
"""


def _method_name(unit: str) -> str:
    """A name of a conversion by its unit: letters and digits alone."""
    spelled = unit.replace("/", "_per_").replace("^", "").replace(" ", "_").replace("(", "").replace(")", "")
    return f"as_{spelled}" if unit else "as_number"


def _method(unit: str) -> str:
    return f'    /begin COMPU_METHOD {_method_name(unit)} "" IDENTICAL "%12.6" "{unit}"\n    /end COMPU_METHOD'


def _where(leaf: Leaf, symbol: str) -> str:
    return f'      SYMBOL_LINK "{symbol}" {leaf.offset}'


def _range(leaf: Leaf, model: DataModel) -> str:
    return f"{model.least} {model.most}" if leaf.integer else f"-{_SINGLE_MAX} {_SINGLE_MAX}"


def _measurement(leaf: Leaf, model: DataModel, symbol: str, address: int, unit: str, words: str) -> str:
    kind = model.int_type if leaf.integer else "FLOAT32_IEEE"
    return (
        f'    /begin MEASUREMENT {symbol}.{leaf.place} "{words}"\n'
        f"      {kind} {_method_name(unit)} 0 0 {_range(leaf, model)}\n"
        f"      ECU_ADDRESS 0x{address + leaf.offset:X}\n{_where(leaf, symbol)}\n    /end MEASUREMENT"
    )


def _characteristic(leaf: Leaf, model: DataModel, symbol: str, address: int, unit: str, words: str) -> str:
    layout = "one_int" if leaf.integer else "one_float"
    return (
        f'    /begin CHARACTERISTIC {symbol}.{leaf.place} "{words}"\n'
        f"      VALUE 0x{address + leaf.offset:X} {layout} 0 {_method_name(unit)} {_range(leaf, model)}\n"
        f"{_where(leaf, symbol)}\n    /end CHARACTERISTIC"
    )
