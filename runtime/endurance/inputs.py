"""Inputs of a target, which are strings of bytes: shortened, put into words, chosen, and kept in one file a target."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterable
from pathlib import Path

from runtime.endurance.target import Replayer, Target, Verdict
from runtime.system.errors import UserError
from runtime.system.files import whole_file

#: Longest input, bytes: enough for a whole state and some steps.
LONGEST = 192
#: Inputs kept of each target: they are played again by a test, and lie in the repository.
MOST_KEPT = 80

OPERATIONS = ("steps", "step bits", "step special", "word bits", "word special", "word flip", "word scaled", "other")


def seeds() -> list[bytes]:
    """Something of every operation, from rest and from a filter that has run, so that no search begins with nothing."""
    every = [bytes([16])]
    every += [bytes([1 + 8 * 14, 0, 0, 0xC0, 0x7F]), bytes([2, 0, 2, 4, 8]), bytes([2, 30, 31, 32, 33])]
    every += [bytes([3, word, 0, 0, 0xC0, 0x7F]) for word in range(0, 40, 3)]
    every += [bytes([4, word, value]) for word in range(0, 40, 5) for value in (0, 3, 8, 30, 32)]
    every += [bytes([5, word, 30]) for word in range(0, 40, 7)] + [bytes([6, word, 250]) for word in range(0, 40, 7)]
    every += [bytes([7, what]) for what in (0, 1, 2, 3, 8, 255)]
    return [bytes([warm]) + one for warm in (0, 1) for one in every]


def shorten(data: bytes, same: Callable[[bytes], bool]) -> bytes:
    """The input without the bytes that ``same`` does not miss, and zeros for those that may be anything."""
    step = max(1, len(data) // 2)
    while step:
        at = 1
        while at < len(data):
            less = data[:at] + data[at + step :]
            if same(less):
                data = less
            else:
                at += step
        step //= 2
    for at in range(len(data)):
        plain = data[:at] + b"\0" + data[at + 1 :]
        if data[at] and same(plain):
            data = plain
    return data


def shortest(data: bytes, replayer: Replayer) -> tuple[bytes, Verdict]:
    """A finding's shortest input that ends in the same kind of verdict about the same word."""
    wanted = replayer.play(data)[0]

    def same(other: bytes) -> bool:
        verdict = replayer.play(other)[0]
        return (verdict.kind, verdict.word) == (wanted.kind, wanted.word)

    data = shorten(data, same)
    return data, replayer.play(data)[0]


def choose(inputs: Iterable[bytes], replayer: Replayer, most: int = MOST_KEPT) -> list[bytes]:
    """Good inputs that show every feature any of them shows, the shortest first; at most so many."""
    shown = []
    for data in set(inputs):
        verdict, seen = replayer.play(data)
        if verdict.kind == 0:
            shown.append((len(data), data, seen))
    shown.sort(key=lambda item: item[:2])
    chosen: list[bytes] = []
    known: set[int] = set()
    while shown and len(chosen) < most:
        _, data, seen = max(shown, key=lambda item: (len(item[2] - known), -item[0]))
        if not seen - known:
            break
        known |= seen
        chosen.append(data)
    return sorted(chosen)


def read_kept(path: Path) -> list[bytes]:
    """The inputs of a file: for each its length, 2 bytes little-endian, and itself; none where there is no file.

    Raises
    ------
    UserError
        If it cannot be read or ends within an input.
    """
    if not path.exists():
        return []
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise UserError(f"cannot read '{path}': {error.strerror}.") from None
    inputs, at = [], 0
    while at < len(raw):
        length = int.from_bytes(raw[at : at + 2], "little")
        if at + 2 + length > len(raw):
            raise UserError(f"'{path}' ends within an input: it is no file of kept inputs, or was cut off.")
        inputs.append(raw[at + 2 : at + 2 + length])
        at += 2 + length
    return inputs


def write_kept(path: Path, inputs: Iterable[bytes]) -> None:
    """The file that :func:`read_kept` reads."""
    with whole_file(path) as file:
        for data in inputs:
            file.write(struct.pack("<H", len(data)) + data)


def describe(data: bytes, target: Target) -> str:
    """An input in words: what it starts from, and its operations as fuzz_target.c plays them."""
    names = word_names(target)
    rest = list(data)

    def take() -> int:
        return rest.pop(0) if rest else 0

    said = ["from a filter that has run" if take() % 2 else "from the start"]
    while rest:
        byte = take()
        operation, more = OPERATIONS[byte % 8], byte // 8
        if operation == "steps":
            said.append(f"{more % 8 + 1} ordinary steps")
        elif operation.startswith("step "):
            said.append("step(" + ", ".join(_input(operation, more >> k & 1, take) for k in range(4)) + ")")
        elif operation == "other":
            said.append(_other(take(), take, target))
        else:
            said.append(f"{names[take() % len(names)]} {_change(operation, take)}")
    return "; ".join(said)


def word_names(target: Target) -> list[str]:
    """Names of all words in the player's order, such as LD[3]."""
    names = []
    for entry in target.fields[0]:
        prefix = target.core if entry[0] == "F" else target.name
        header = target.sources[f"{prefix}.h"]
        found = re.search(rf"float32 {entry[2:-1]}(?:\[(\d+)\])?;", header)
        assert found is not None, entry
        names += [f"{entry[2:-1]}[{k}]" for k in range(int(found[1]))] if found[1] else [entry[2:-1]]
    return names


#: As in fuzz_target.c: its table, then infinities and NaNs.
_SPECIAL = (
    "0", "-0", "1", "-1", "1e-45", "-1e-45", "1.2e-38", "-1.2e-38", "3.4e38", "-3.4e38", "1e-18", "1e-20", "1e18",
    "-1e18", "1e19", "-1e19", "1e20", "pi", "-pi", "3.1415925", "2pi", "1e3", "1e6", "2^23 1.5", "-2^23 1.5",
    "2^24 1.5", "1e-6", "1e6", "8", "0.125", "inf", "-inf", "nan", "nan (signalling)", "-nan", "nan (all bits)",
)  # fmt: skip


def _number(take: Callable[[], int]) -> str:
    return f"{struct.unpack('<f', bytes(take() for _ in range(4)))[0]:.9g}"


def _input(operation: str, ordinary: int, take: Callable[[], int]) -> str:
    if ordinary:
        return "ordinary"
    return _number(take) if operation == "step bits" else _SPECIAL[take() % len(_SPECIAL)]


def _change(operation: str, take: Callable[[], int]) -> str:
    if operation == "word bits":
        return f"= {_number(take)}"
    if operation == "word special":
        return f"= {_SPECIAL[take() % len(_SPECIAL)]}"
    if operation == "word flip":
        return f"bit {take() & 31} flipped"
    return f"times 2^{take() - 128}"


def _other(what: int, take: Callable[[], int], target: Target) -> str:
    if what & 3 == 0:
        return f"max_iterations = {-32767 if what >> 2 == 63 else (what >> 2) % 14 - 1}"
    if what & 3 == 1:
        return "reset"
    if what & 3 == 2:
        n = len(target.folder.manifest["states"])
        return "x, LD = " + ", ".join(_number(take) for _ in range(n + n * (n + 1) // 2))
    integers = [entry[2:-1] for entry in target.fields[1]] or ["max_iterations"]
    values = (0, 1, 32767, -32767, 2147483647, -2147483647, 2, -1)
    return f"{integers[(what >> 5) % len(integers)]} = {values[what >> 2 & 7]}"
