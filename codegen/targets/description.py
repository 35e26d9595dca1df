"""What a target is: word sizes, arithmetic, sections, prices and a stand-in. Nothing else in codegen knows one's name.

A description lies in a file of :mod:`codegen.targets.chips`; a drive file chooses it with ``[target] name``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

from codegen.targets.numbers import PORTED, NumberFormat


@dataclass(frozen=True)
class DataModel:
    """Sizes of C's types.

    Attributes
    ----------
    char_bits : int
        Bits of a char.
    sizes : mapping of str to int
        Chars of each arithmetic type, by its name without ``signed`` and ``unsigned``.
    pointer : int
        Chars of a pointer.
    alignment : int
        Chars: no type is aligned to more.
    source : str
        Where that is published.
    """

    char_bits: int
    sizes: Mapping[str, int]
    pointer: int
    alignment: int
    source: str

    @property
    def in_words(self) -> bool:
        """The unit of memory is a word of 16 bits; else a byte."""
        return self.char_bits == 16

    def words(self, chars: int) -> int:
        """16-bit words, begun ones included.

        Parameters
        ----------
        chars : int

        >>> DataModel(8, {}, 4, 8, "").words(6)
        3
        """
        return -(-chars * self.char_bits // 16)

    @property
    def macros(self) -> dict[str, str]:
        """What ``limits.h`` and ``float.h`` say of it."""
        bits = self.char_bits * self.sizes["int"]
        return {
            "FLT_RADIX": "2",
            "FLT_MANT_DIG": "24",
            "FLT_MAX_EXP": "128",
            "FLT_MIN_EXP": "-125",
            "CHAR_BIT": str(self.char_bits),
            "UINT_MAX": f"0x{2**bits - 1:X}U",
        }


@dataclass(frozen=True)
class Compiler:
    """The compiler as the port header meets it.

    Attributes
    ----------
    macro : str
        By which the text knows that it is this compiler; empty: nothing is particular to it.
    macros : mapping of str to str
        What it defines with the flags that are asked for, ``macro`` included.
    checks : str
        Preprocessor lines between ``#ifdef macro`` and ``#endif``: wrong flags end in one clear ``#error``.
    types_guard : str
        Macro by which the device header, if it came first, says that it has defined the types.
    device_header : str
        The header that uses this guard, in words; empty: there is none.
    types : tuple of (str, str)
        Types and names that this header defines under the guard, where the width does not tell them.
    keyword : str
        Keyword of an interrupt function; empty: it is a plain function.
    builtin_sqrt : bool
        Where it says that it is GNU's, it knows ``__builtin_sqrtf``; else its ``math.h`` declares sqrtf in C89, too.
    """

    macro: str = ""
    macros: Mapping[str, str] | tuple[()] = ()
    checks: str = ""
    types_guard: str = "PMSM_DATA_TYPES"
    device_header: str = ""
    types: tuple[tuple[str, str], ...] = ()
    keyword: str = ""
    builtin_sqrt: bool = True


@dataclass(frozen=True)
class NativeMath:
    """Instructions of the port header's macros, behind ``#ifdef macro``; elsewhere the macros are C's own operators.

    Attributes
    ----------
    macro : str
        The compiler defines it where the instructions may be used.
    lines : tuple of str
        The macros' definitions.
    what : str
        What they are, for the comment above them, its end included.
    calls : mapping of str to str
        The functions behind the macros, and the ledger's name of what each does.
    """

    macro: str
    lines: tuple[str, ...]
    what: str
    calls: Mapping[str, str]


@dataclass(frozen=True)
class Sections:
    """How functions of the interrupt come to lie in fast memory.

    Attributes
    ----------
    style : {"pragma", "attribute", "none"}
        ``CODE_SECTION`` pragmas before the first declaration (TI), a macro before each function (GCC, Clang, Arm),
        or nothing.
    where, why : str
        Behind which condition; and the comment's words.
    names : tuple of (str, str)
        Conditions and section names: the first condition that holds; an empty one always does.
    """

    style: Literal["pragma", "attribute", "none"] = "none"
    where: str = ""
    why: str = ""
    names: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Arithmetic:
    """How the processor's float32 differs from IEEE's, and a NumPy model of it.

    Attributes
    ----------
    number : type
        The model's number, with the operators of one of NumPy (:class:`codegen.evidence.fpu32.FPU32`).
    differs : str
        What differs, after "On the chip its".
    caveat : str
        Line in the head of a C file: what the model is worth.
    story : str
        What differs and what the model is worth, for REPORT.md.
    selftest : str
        Where the self-test's allowance is meant for, in the port header.
    sin_cos : callable, optional
        Sine and cosine of the instructions, where the text uses them.
    """

    number: type[Any]
    differs: str
    caveat: str
    story: str
    selftest: str
    sin_cos: Callable[[Any], tuple[Any, Any]] | None = None


@dataclass(frozen=True)
class Prices:
    """Published cycles. What nobody published is no price: a target without one has ``prices = None``.

    The sum is an estimate: what the ledger counts is in it once. k is an operation on numbers with what it needs:
    loads, the slot it waits in, the store. Branches and calls are no part of k and have prices of their own; a
    division, a root or a copy has its loads in its own price. Not in the sum: arithmetic of whole numbers, copies of
    single numbers that are no operands, registers that a function saves, and wait states of the memory in which the
    code lies.

    Attributes
    ----------
    clock : float
        Hz.
    factors : tuple of float
        k, cycles of an operation of ``at_k`` with its loads and its store: typical first, the bound last.
    at_k : tuple of str
        Operations of :mod:`codegen.evidence.ledger` that are priced at k.
    cycles : mapping of str to int
        Cycles by operation, of the others.
    interrupt : int
        Cycles of an interrupt's entry and exit.
    reciprocal : int
        Cycles of a seed and two Newton steps in line, in the place of the division that they do without; 0: not known.
    on : str
        The processor, as the C file's head calls it.
    formula, k, sources : str
        The sum in words, what k stands for, and where the figures are published.
    """

    clock: float
    factors: tuple[float, ...]
    at_k: tuple[str, ...]
    cycles: Mapping[str, int]
    interrupt: int
    on: str
    formula: str
    k: str
    sources: str
    reciprocal: int = 0

    @property
    def periods(self) -> dict[str, int]:
        """Cycles of a period by its frequency."""
        return {f"{f:g} kHz": round(self.clock / (1e3 * f)) for f in (10, 20, 50)}

    @property
    def sum(self) -> str:
        """The sum as a formula; what few functions have, words of copied structs, is left out."""
        others = "".join(f" + {price} {name}" for name, price in self.cycles.items() if name != "copied")
        return f"k ({' + '.join(self.at_k)}){others} + {self.interrupt}"

    def total(self, operations: Mapping[str, int], k: float) -> int:
        """Cycles of one call.

        Parameters
        ----------
        operations : mapping of str to int
            Counts by the ledger's names; a name that is missing counts 0.
        k : float
            Cycles an operation of ``at_k`` is priced at.

        >>> prices = Prices(1e6, (2.5,), ("add", "mul"), {"div": 25}, 60, "", "", "", "")
        >>> prices.total({"add": 10, "mul": 10, "div": 1}, k=2.5)
        135
        >>> prices.sum
        'k (add + mul) + 25 div + 60'
        """
        priced = sum(price * operations.get(name, 0) for name, price in self.cycles.items())
        return round(k * sum(operations.get(name, 0) for name in self.at_k) + priced + self.interrupt)


@dataclass(frozen=True)
class StandIn:
    """A processor whose compiler is at hand: it tells stack and code size.

    Attributes
    ----------
    name, short : str
        As prose and as a table's head call it.
    compiler : str
        GCC's program; its ``size`` goes by the same prefix.
    package : str
        The Debian package that brings it.
    flags : tuple of str
        Of a measurement.
    """

    name: str
    short: str
    compiler: str
    package: str
    flags: tuple[str, ...]


@dataclass(frozen=True)
class Board:
    """A machine of ``qemu-system-arm`` on which the target's text runs: it shows its bits and counts instructions.

    Attributes
    ----------
    machine, cpu : str
        qemu's words.
    flags : tuple of str
        Of the cross compiler: processor, floating-point unit, calling convention.
    code, data : int
        Addresses of 4 MB of code memory, where the processor begins, and of 4 MB of data memory.
    clock : float
        Hz of the counter SysTick.
    """

    machine: str
    cpu: str
    flags: tuple[str, ...]
    code: int
    data: int
    clock: float


@dataclass(frozen=True)
class Example:
    """Words of the example interrupt that are the device's.

    Attributes
    ----------
    device : str
        What it runs on.
    acknowledge, gates, serial : str
        How an interrupt is acknowledged, where the gates are latched off, and through what numbers go out.
    """

    device: str
    acknowledge: str
    gates: str
    serial: str


@dataclass(frozen=True)
class Target:
    """One processor and its compiler.

    Attributes
    ----------
    name : str
        The word of the drive file and of ``--target``; its file's name.
    title : str
        As prose calls it.
    core : str
        The processor, as a table calls it.
    purpose : str
        Behind "For" in the head of a C file.
    language : str
        Of the generated files, for REPORT.md.
    data : DataModel
    stand_in : StandIn
    example : Example
    compiler : Compiler
    numbers : NumberFormat
        How C spells its numbers; float32 everywhere.
    native : NativeMath, optional
        Instructions for what ``numbers`` spells as macros.
    sections : Sections
    arithmetic : Arithmetic, optional
        None: IEEE 754, and the bits are the host's.
    prices : Prices, optional
        None: nobody published what prices compiled C.
    board : Board, optional
        Where the text is run; None: nowhere, and REPORT.md says so.
    subset : str
        Rules of a subset of C that the text must keep: a gate of ``runtime.firmware.static``; empty: none.
    not_shown : str
        What is not run or not measured here, in words.
    """

    name: str
    title: str
    core: str
    purpose: str
    language: str
    data: DataModel
    stand_in: StandIn
    example: Example
    compiler: Compiler = Compiler()
    numbers: NumberFormat = PORTED
    native: NativeMath | None = None
    sections: Sections = Sections()
    arithmetic: Arithmetic | None = None
    prices: Prices | None = None
    board: Board | None = None
    subset: str = ""
    not_shown: str = ""

    @cached_property
    def macros(self) -> dict[str, str]:
        """Macros under which the target's compiler reads the text."""
        return dict(self.compiler.macros) | self.data.macros
