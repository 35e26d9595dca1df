"""Every printed figure, bound, size and unit against what it is said to be, found by another way.

A folder is generated in memory with figures of which no two are alike (certificates, stack, code), so that two
columns, rows or labels that are exchanged show; costs are recomputed from the printed operations, sizes from the
printed structs, certificates by a loop over single samples.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest

import codegen.generate as pipeline
from codegen.evidence.box import sample_box
from codegen.evidence.certificate import Certificate, ChipModel, Figures, certify, certify_chip
from codegen.evidence.fpu32 import FPU32, Flushed
from codegen.evidence.ledger import Program
from codegen.evidence.recording import execute
from model.drives.load import load_drive
from model.machines.state_space import build, default_initial_state
from model.schema import Drive
from tests.conftest import shipped_package

DRIVES = ("ipmsm_flux", "paper_spmsm")
PRICES = {"div": 25, "sqrt": 29, "sincos": 44}
KS = (2.5, 4, 5)
OPERATIONS = ["add", "mul", "div", "sqrt", "sincos", "compare", "select"]
CLOCK = 150e6


def price(operations: Mapping[str, float], k: float) -> int:
    """The published formula, 60 cycles for the interrupt with it."""
    cheap = operations["add"] + operations["mul"]
    return round(k * cheap + sum(PRICES[name] * operations[name] for name in PRICES) + 60)


@dataclass(frozen=True)
class Made:
    """A folder in memory, the figures it was given, and its report's tables."""

    drive: Drive
    files: dict[str, str]
    figures: dict[str, Figures]
    measured: dict[str, dict[str, Any]]

    @property
    def facts(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.files["manifest.json"])
        return found

    @property
    def report(self) -> str:
        return self.files["REPORT.md"]

    @property
    def tables(self) -> list[list[list[str]]]:
        """Rows of cells, heads first."""
        found: list[list[list[str]]] = []
        before = ""
        for line in self.report.splitlines():
            if line.startswith("|"):
                if not before.startswith("|") and not (before == "" and found and _is_rule(line)):
                    found.append([])
                cells = [cell.strip() for cell in line.strip("|").split("|")]
                if not _is_rule(line):
                    found[-1].append(cells)
            before = line
        return found

    def table(self, *head: str) -> dict[str, list[str]]:
        """The table whose head begins with these cells: rows by their first cell."""
        for rows in self.tables:
            if rows and rows[0][: len(head)] == list(head):
                return {row[0]: row[1:] for row in rows}
        raise AssertionError(f"no table with the head {head}")

    def words(self, name: str) -> str:
        """A file's text without comment marks and line ends."""
        return " ".join(re.sub(r"^ \*|/\*|\*/", " ", self.files[name], flags=re.MULTILINE).split())


def _is_rule(line: str) -> bool:
    return set(line) <= set("|-")


def _figures(kinds: Iterator[str] | list[str], states: int) -> dict[str, Figures]:
    """Certificates of which no two numbers are alike in two digits."""
    number = count(11)

    def certificate(samples: int) -> Certificate:
        values = [next(number) * 10.0 ** -(3 + k % 4) for k in range(states + 2)]
        return Certificate(samples, tuple(values[:-2]), values[-2], values[-1], next(number), next(number))

    return {kind: Figures(certificate(2345), ChipModel(certificate(2345), certificate(2345))) for kind in kinds}


@pytest.fixture(scope="module", params=DRIVES)
def made(request: pytest.FixtureRequest) -> Made:
    drive = load_drive(request.param)
    measured: dict[str, dict[str, Any]] = {}

    def measurer(files: Mapping[str, str], program: Any, function: str) -> dict[str, Any]:
        k = len(measured)
        record = {"stack_bytes": 111 + 10 * k, "text_bytes": 5003 + 100 * k, "compiler": "arm-none-eabi-gcc 9.8.7"}
        return dict(measured.setdefault(function, {"source_sha256": "0" * 64, **record}))

    figures = _figures(list(drive.filter.kinds), len(drive.filter.process_noise))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pipeline, "certify_module", lambda *given: figures)
        files = pipeline.generate(drive, measurer=measurer).files  # type: ignore[arg-type]
    return Made(drive, files, figures, measured)


def subjects(made: Made) -> Iterator[tuple[str, str, dict[str, Any], str]]:
    """Row of the report, C function, what the manifest says, the struct's name."""
    for kind in made.drive.filter.kinds:
        facts, stem = made.facts["filters"][kind], f"{made.drive.name}_{kind}"
        yield kind, f"{stem}_step", facts, f"{stem}_t"
        yield f"{kind} and controller", f"{stem}_foc_step", facts["controller"], f"{stem}_foc_t"


# --- cost


def test_operations_are_those_of_the_text(made: Made) -> None:
    table = made.table("step", "add", "mul")
    assert table["step"] == [*OPERATIONS, "add, expanded", "mul, expanded"]
    for row, function, facts, _ in subjects(made):
        stem = function.removesuffix("_foc_step").removesuffix("_step")
        program = Program(made.files, f"{stem}.c", f"{stem}_foc.c")
        called, expanded = (
            program.count(function, made.drive.filter.max_iterations, expand) for expand in (False, True)
        )
        numbers = [called[name] for name in OPERATIONS] + [expanded["add"], expanded["mul"]]
        assert [int(cell) for cell in table[row]] == numbers
        assert facts["operations"] == {name: called[name] for name in OPERATIONS}
        assert facts["operations_sincos_expanded"] == {name: expanded[name] for name in OPERATIONS}
    assert made.facts["filters"]["ckf"]["operations"]["add"] < made.facts["filters"]["ckf"]["controller"][
        "operations"]["add"]  # fmt: skip
    assert f"every loop over N_max taken {made.drive.filter.max_iterations} times" in made.report


def test_cycles_are_the_sum_of_prices(made: Made) -> None:
    table = made.table("step", "cycles, k = 2.5 / 4 / 5", "expanded")
    T = made.drive.model.sample_time
    periods = [("10 kHz", 1e-4), ("20 kHz", 5e-5), ("50 kHz", 2e-5), (f"T = {T * 1e6:g} us", T)]
    assert table["step"][2:] == [f"% of {name} ({CLOCK * period:.0f})" for name, period in periods]
    for row, _, facts, _ in subjects(made):
        called = [price(facts["operations"], k) for k in KS]
        expanded = [price(facts["operations_sincos_expanded"], k) for k in KS]
        assert facts["cycles"] == dict(zip(("2.5", "4", "5"), called, strict=True))
        assert facts["cycles_sincos_expanded"] == dict(zip(("2.5", "4", "5"), expanded, strict=True))
        assert facts["estimated_cycles"] == called[0]
        cells = [[int(value) for value in cell.split(" / ")] for cell in table[row]]
        shares = [[round(100 * value / (CLOCK * period)) for value in called] for _, period in periods]
        assert cells == [called, expanded, *shares]
    assert "`k (add + mul) + 25 div + 29 sqrt + 44 sincos + 60`" in made.report
    assert "TI's fastRTS figures and 60 for the interrupt" in made.report
    assert "at 150 MHz, for the three k in turn" in made.report


def test_the_heads_of_the_c_say_what_the_manifest_says(made: Made) -> None:
    for row, function, facts, struct in subjects(made):
        text, ops = made.words(f"{struct.removesuffix('_t')}.c"), facts["operations"]
        title = "Cost at most, with the filter" if "controller" in row else "Cost at most"
        says = (
            f"{title}: {ops['add']} add, {ops['mul']} mul, {ops['div']} div, {ops['sqrt']} sqrt, "
            f"{ops['sincos']} sincos; estimated {price(ops, 2.5)} cycles on C28x + FPU32 (k = 2.5; "
            f"{price(ops, 5)} at k = 5; from published cycles, not measured), {facts['state_words']} words of state."
        )
        assert says in text, function


def struct_words(made: Made, struct: str) -> int:
    """16-bit words by hand: floats take two, int and pointers as the C28x has them; even addresses for 32 bits."""
    text = re.sub(r"/\*.*?\*/", "", made.files[f"{struct.removesuffix('_t')}.h"], flags=re.DOTALL)
    body = re.search(rf"typedef struct \{{([^}}]*)\}} {struct};", text)
    assert body is not None
    offset = 0
    for kind, size in re.findall(r"(\w+) \w+(?:\[(\d+)\])?;", body[1]):
        one = {"float32": 2, "int": 1}.get(kind) or struct_words(made, kind)
        offset += (offset % 2 if kind != "int" else 0) + one * int(size or 1)
    return offset + offset % 2


def test_ram_stack_and_code_stand_in_their_columns(made: Made) -> None:
    table = made.table("step", "RAM, words", "stack, bytes (M4F)", "code, bytes (M4F)")
    assert len(table["step"]) == 3
    for row, function, facts, struct in subjects(made):
        words = struct_words(made, struct)
        record = made.measured[function]
        assert [int(cell) for cell in table[row]] == [words, record["stack_bytes"], record["text_bytes"]]
        assert facts["state_words"] == words
        assert made.facts["measured"][function] == record
    assert "measured on a stand-in, arm-none-eabi-gcc 9.8.7 `-mcpu=cortex-m4" in made.report
    assert "not measured:" not in made.report
    assert "(float32 2, int 1, 32-bit fields on even addresses)" in made.report


def test_the_budget_is_the_drive_files(made: Made) -> None:
    limits = {key: value for key, value in made.drive.budget.model_dump().items() if value is not None}
    if len(limits) > 1:
        said = ", ".join(f"{key} = {value}" for key, value in limits.items())
        assert f"The drive file allows: {said}; `generate` fails beyond." in made.report
    else:
        assert "The drive file sets no limits" in made.report


# --- how far float32 can be trusted


def two_digits(value: float) -> str:
    return f"{value:.1e}"


def row_of(certificate: Certificate) -> list[str]:
    numbers = [*certificate.x, certificate.P_99, certificate.P]
    return [*(two_digits(v) for v in numbers), str(certificate.not_finite), str(certificate.indefinite)]


def test_each_certificate_stands_in_its_row(made: Made) -> None:
    units = [f"{state['name']}, {state['unit']}" for state in made.facts["states"]]
    tail = ["P, 99 %", "P, worst", "not finite", "indefinite"]
    host, chip = made.table("filter", units[0]), made.table("filter, arithmetic", units[0])
    assert host["filter"] == chip["filter, arithmetic"] == [*units, *tail]
    for kind, figures in made.figures.items():
        assert host[kind] == row_of(figures.certificate)
        assert chip[f"{kind}, chip"] == row_of(figures.chip.fpu32)
        assert chip[f"{kind}, flush to zero alone"] == row_of(figures.chip.flushed)
        facts = made.facts["filters"][kind]
        for said, certificate in (
            (facts["certificate"], figures.certificate),
            (facts["chip_model"]["fpu32"], figures.chip.fpu32),
            (facts["chip_model"]["flushed"], figures.chip.flushed),
        ):
            assert said == {
                "samples": 2345,
                "x": [float(two_digits(v)) for v in certificate.x],
                "P_99": float(two_digits(certificate.P_99)),
                "P": float(two_digits(certificate.P)),
                "not_finite": certificate.not_finite,
                "indefinite": certificate.indefinite,
            }
    box = made.drive.operating_box
    assert (
        f"worst of 2345 draws from the operating box (|i| <= {box.current:g} A, |v| <= {box.voltage:g} V, "
        f"|omega| <= {box.speed:g} rad/s;"
    ) in made.report


def test_the_heads_of_the_c_quote_their_certificate(made: Made) -> None:
    states = made.facts["states"]

    def says(certificate: Certificate) -> str:
        each = [f"{s['name']} {two_digits(v)} {s['unit']}" for s, v in zip(states, certificate.x, strict=True)]
        return f"{', '.join(each)}, P {two_digits(certificate.P)} relative (99 %: {two_digits(certificate.P_99)})"

    for kind, figures in made.figures.items():
        text = made.words(f"{made.drive.name}_{kind}.c")
        host = "float32 against float64, one step, worst of 2345 draws from the operating box"
        assert f"{host}: {says(figures.certificate)}." in text
        assert f"are expected to add {says(figures.chip.fpu32)} (modelled, not measured;" in text
        assert "float32 against float64" not in made.words(f"host/{made.drive.name}_{kind}_f64.c")


@pytest.mark.parametrize("name", DRIVES)
def test_certificates_are_the_worst_of_single_steps(name: str) -> None:
    """One sample after the other, and the worst kept by hand."""
    drive = load_drive(name)
    module = execute(shipped_package(name).files[f"{name}.py"], "m")
    box, kind = sample_box(drive, build(drive), 40), drive.filter.kinds[-1]
    single, double, chip, flushed = (
        [one(module, kind, box, k, dtype, number) for k in range(40)]
        for dtype, number in (("float32", None), ("float64", None), ("float32", FPU32), ("float32", Flushed))
    )
    model = certify_chip(module, kind, box)
    for found, runs, against in (
        (certify(module, kind, box), single, double),
        (model.fpu32, chip, single),
        (model.flushed, flushed, single),
    ):
        x_off, P_off = np.zeros(len(found.x)), []
        for (x, P), (x_2, P_2) in zip(runs, against, strict=True):
            off = np.abs(x - x_2)
            off[3] = min(off[3], 2 * np.pi - off[3])
            x_off = np.maximum(x_off, off)
            sigma = np.sqrt(np.diag(P_2))
            P_off.append(np.max(np.abs(P - P_2) / np.outer(sigma, sigma)))
        ordered = sorted(P_off)
        assert found.samples == 40
        assert found.x == pytest.approx(x_off.tolist(), rel=1e-6)
        assert pytest.approx(ordered[-1], rel=1e-6) == found.P
        assert pytest.approx(ordered[-2] + 0.61 * (ordered[-1] - ordered[-2]), rel=1e-6) == found.P_99
        assert (found.not_finite, found.indefinite) == (0, 0)
    assert certify(module, kind, box).P > 0
    assert model.fpu32.P > 0


def one(module: dict[str, Any], kind: str, box: Any, k: int, dtype: str, number: Any) -> tuple[np.ndarray, np.ndarray]:
    """x and P after one step from one sample."""
    math, n = module["MATH"][dtype], len(module["STATES"])
    to = (lambda v: number(math.dtype(v))) if number else math.dtype
    state = SimpleNamespace(
        **{
            key: tuple(to(v) for v in value) if isinstance(value, tuple) else to(value)
            for key, value in module["DEFAULTS"].items()
            if key != "max_iterations"
        },
        max_iterations=module["DEFAULTS"]["max_iterations"],
    )
    P = np.zeros((n, n))
    P[np.tril_indices(n)] = box.P[:, k]
    words = np.float32(module["pack"](P + np.tril(P, -1).T))
    state.x = tuple(to(v) for v in box.x[:, k])
    setattr(state, module["COVARIANCE"], tuple(to(v) for v in words))
    state.u_held, state.nis, state.repairs = (to(0), to(0)), to(0), 0
    with np.errstate(all="ignore"):
        module["STEPS"][kind](state, [to(v) for v in box.u[:, k]], [to(v) for v in box.y[:, k]], math)
    words = np.array([float(v) for v in getattr(state, module["COVARIANCE"])])
    return np.array([float(v) for v in state.x]), module["unpack"](words)


def test_what_is_no_covariance_is_counted() -> None:
    """A step that leaves, in float32 alone, two lanes that are no number and three with a negative variance."""
    n, lanes = 4, 10

    def step(state: Any, u: Any, y: Any, math: Any) -> int:
        if math.dtype is np.float32:
            x = np.array(state.x)
            x[1, :2] = np.nan
            state.x = tuple(x)
            words = np.array(state.P)
            words[0, 5:8] *= -1
            state.P = tuple(words)
        return 0

    rows, columns = np.tril_indices(n)

    def unpack(words: np.ndarray) -> np.ndarray:
        P = np.zeros((n, n, *words.shape[1:]))
        P[rows, columns] = P[columns, rows] = words
        return P

    module = {
        "MATH": {d: SimpleNamespace(dtype=getattr(np, d)) for d in ("float32", "float64")},
        "STATES": ("a", "b", "c", "d"),
        "COVARIANCE": "P",
        "ANGLE": 3,
        "DEFAULTS": {},
        "STEPS": {"k": step},
        "pack": lambda P: P[rows, columns],
        "unpack": unpack,
    }
    eye = np.repeat(np.eye(n)[rows, columns][:, None], lanes, axis=1)
    box = SimpleNamespace(x=np.zeros((n, lanes)), P=eye, u=np.zeros((2, lanes)), y=np.zeros((2, lanes)))
    found = certify(module, "k", box)  # type: ignore[arg-type]
    assert (found.samples, found.not_finite, found.indefinite) == (lanes, 2, 3)


def test_draws_fill_the_box_and_no_more() -> None:
    """Within the declared box, near its edges, sigmas from the process noise to twice P_0."""
    for name in ("paper_spmsm", "ipmsm_flux", "spmsm_load_torque"):
        drive = load_drive(name)
        model, box = build(drive), drive.operating_box
        draws = sample_box(drive, model, 2000)
        n = len(model.states)
        P = np.zeros((2000, n, n))
        P[:, *np.tril_indices(n)] = draws.P.T
        sigma = np.sqrt(np.einsum("bii->bi", P))
        low, high = np.sqrt(drive.filter.process_noise), np.sqrt(drive.filter.initial_covariance)
        assert np.all(sigma >= 0.99 * np.minimum(low, high))
        assert np.all(sigma <= 2.02 * np.maximum(low, high))
        assert np.all(np.max(sigma, 0) > 0.8 * np.maximum(low, high))
        assert 0.97 * box.speed < np.max(np.abs(draws.x[2])) <= box.speed * (1 + 1e-6)
        assert 3.1 < np.max(np.abs(draws.x[3])) <= np.pi
        assert 0.97 * box.voltage < np.min(np.max(np.abs(draws.u), 1)) <= np.max(np.abs(draws.u)) <= box.voltage
        assert np.max(np.abs(draws.y)) <= box.current
        if name == "paper_spmsm":
            assert 0.68 * box.current < np.max(np.abs(draws.x[:2])) <= 0.7 * box.current
        if name == "spmsm_load_torque":
            assert 0.97 * box.load_torque < np.max(np.abs(draws.x[4])) <= box.load_torque
        correlation = P / (sigma[:, :, None] * sigma[:, None, :])
        assert np.max(np.abs(correlation[:, 1, 0])) > 0.8
        assert np.min(np.abs(correlation[:, 1, 0])) < 0.05


def test_sine_cosine_and_small_angles_are_within_the_printed_bounds(made: Made) -> None:
    """The module's own functions at other arguments, against the library's float64."""
    name = made.drive.name
    texts = [made.words(f"{name}_ckf.c"), made.words(f"{name}_ckf_foc.c")]
    pattern = r"Error for \|x\| <= (\d+) rad: proved (\S+), worst of (\d+) arguments (\S+)\."
    said = {re.search(pattern, text).groups() for text in texts}  # type: ignore[union-attr]
    report = re.search(r"\|x\| <= (\d+) rad\): error proved <= (\S+), worst of (\d+) arguments (\S+)\.", made.report)
    assert report is not None
    assert said == {report.groups()}
    limit, proved, samples, seen = (float(word) for word in report.groups())
    assert (limit, samples) == (1000, 200_002)
    module = execute(made.files[f"{name}.py"], "m")
    x = np.random.default_rng(5).uniform(-limit, limit, 300_000).astype(np.float32)
    exact = np.sin(x.astype(float)), np.cos(x.astype(float))
    worst = max(np.max(np.abs(a - b)) for a, b in zip(module["MATH"]["float32"].sin_cos(x), exact, strict=True))
    assert 0.8 * seen <= worst <= 1.25 * seen
    assert worst <= proved <= 5 * worst
    if "How far a column of L turns" not in texts[0]:
        return
    small = re.search(
        r"from z = d\^2 / (\d).*?for d up to (\S+) rad\. Error proved: sinc (\S+), cosm1 (\S+) of d\^2 / 2\.", texts[0]
    )
    assert small is not None
    n, widest, sinc_bound, cosm1_bound = (float(word) for word in small.groups())
    z = np.linspace(1e-4, (0.99 * widest) ** 2 / n, 20_000).astype(np.float32)
    d = np.sqrt(n * z.astype(float))
    sinc, cosm1 = getattr(module["MATH"]["float32"], f"small_angle_{n:g}")(z)
    off = np.max(np.abs(sinc - np.sin(d) / d)), np.max(np.abs(cosm1 + 2 * np.sin(d / 2) ** 2) / (d**2 / 2))
    assert off[0] <= sinc_bound <= 6 * off[0]
    assert off[1] <= cosm1_bound <= 6 * off[1]


# --- states, constants, times, units


def test_states_and_their_data_stand_in_their_columns(made: Made) -> None:
    drive, model = made.drive, build(made.drive)
    rows = next(table for table in made.tables if table[0][1:3] == ["state", "unit"])
    assert rows[0] == ["", "state", "unit", "meaning", "x_0", "P_0", "Q per step"]
    x_0 = default_initial_state(drive)
    for k, row in enumerate(rows[1:]):
        state = model.states[k]
        numbers = [f"{value[k]:g}" for value in (x_0, drive.filter.initial_covariance, drive.filter.process_noise)]
        assert row == [str(k), f"`{state.name}`", state.unit, state.meaning, *numbers]
    names = [row[1].strip("`") for row in rows[1:]]
    assert names[2:4] == ["omega", "theta"]
    assert [row[2] for row in rows[3:5]] == ["rad/s", "rad"]
    first = ("psi_alpha", "Wb") if drive.model.machine == "salient_flux" else ("i_alpha", "A")
    assert (names[0], rows[1][2]) == first
    R = ", ".join(str(value) for value in drive.filter.measurement_noise)
    assert f"Measured: `i_alpha`, `i_beta` in A, noise variances R = {R} A^2." in made.report
    facts = made.facts
    assert facts["states"] == [{"name": s.name, "unit": s.unit} for s in model.states]
    assert facts["parameters"] == json.loads(json.dumps(drive.model_dump(exclude={"sha256", "name"})))


def test_the_sample_time_is_said_everywhere_alike(made: Made) -> None:
    T, name = made.drive.model.sample_time, made.drive.name
    said = f"T = {1e6 * T:.0f} us"
    for file in (f"{name}_ckf.h", f"{name}_ckf.c", f"{name}_ckf_foc.h", f"{name}.py", "REPORT.md"):
        assert said in made.files[file][:700], file
        assert not re.search(r"T = (?!" + said[4:] + r")[\d.e+-]+ \w?s\b", made.files[file][:700])
    assert f"once every {1e6 * T:.0f} us" in made.files["example_isr.c"]
    assert float(re.search(r"#define SAMPLE_TIME (\S+)f /\* s \*/", made.files["example_isr.c"])[1]) == T  # type: ignore[index]
    module = execute(made.files[f"{name}.py"], "m")
    assert module["SAMPLE_TIME"] == T
    assert "SAMPLE_TIME = " + repr(T) + "  # s" in made.files[f"{name}.py"]


def test_iteration_is_told_as_it_is(made: Made) -> None:
    drive = made.drive
    if drive.name == "paper_spmsm":
        assert "**Proved idle.**" in made.report
        assert "tolerance; /* eps of (33); unused here" in made.files[f"{drive.name}_ickf.h"]
    else:
        said = f"at most N_max = {drive.filter.max_iterations} passes that ends early once (33) holds with eps = "
        assert f"{said}{drive.filter.tolerance}." in made.report
        assert "eps of (33) */" in made.files[f"{drive.name}_ickf.h"]
        assert "max_iterations; /* N_max */" in made.files[f"{drive.name}_ickf.h"]
    ickf = made.words(f"{drive.name}_ickf.c")
    assert f"Gain: {drive.filter.gain}. Iteration: " in ickf
    assert "Gain:" not in made.words(f"{drive.name}_ckf.c")


def test_entries_that_are_not_zero_are_counted(made: Made) -> None:
    """Central differences of f and h at random points."""
    model = build(made.drive)
    rng = np.random.default_rng(3)
    f = ca.Function("f", [model.x, model.u], [model.numeric(model.f)])
    h = ca.Function("h", [model.x], [model.numeric(model.h)])
    n = len(model.states)
    F, H = np.zeros((n, n)), np.zeros((2, n))
    for _ in range(5):
        x, u = rng.uniform(0.5, 2.0, n), rng.uniform(1, 2, 2)
        for k in range(n):
            d = 1e-4 * np.eye(n)[k]
            F[:, k] += np.abs(np.array(f(x + d, u) - f(x - d, u)).ravel())
            H[:, k] += np.abs(np.array(h(x + d) - h(x - d)).ravel())
    counts = int(np.sum(F > 1e-14)), int(np.sum(H > 1e-14))
    said = f"F has {counts[0]} of {n * n} entries that are not structurally zero, H {counts[1]} of {2 * n}."
    assert said in made.report


def test_constants_are_their_formulas(made: Made) -> None:
    """Of the names that both drives explain: values by hand from the drive file, in report and C."""
    m, T = made.drive.motor, made.drive.model.sample_time
    by_hand = {
        "POLE_PAIRS": m.pole_pairs,
        "SAMPLE_TIME": T,
        "DECAY_I": 1 - T * m.stator_resistance / m.inductance_d,
        "GAIN_V": T / m.inductance_d,
        "GAIN_E": T * m.magnet_flux / m.inductance_d,
        "DECAY_OMEGA": 1 - T * m.friction / m.inertia,
        "L_D": m.inductance_d,
        "L_Q": m.inductance_q,
        "PSI_M": m.magnet_flux,
    }
    if made.drive.model.discretization == "exact":
        for name in ("DECAY_I", "GAIN_V", "GAIN_E", "DECAY_OMEGA"):
            del by_hand[name]
    table = made.table("constant", "value", "formula")
    seen = 0
    for name, value in by_hand.items():
        if f"`{name}`" in table:
            assert float(table[f"`{name}`"][0]) == pytest.approx(value, rel=1e-9)
            seen += 1
        for text in (made.files[f"{made.drive.name}_ckf.c"], made.files[f"{made.drive.name}_ckf_foc.c"]):
            for found in re.findall(rf"^#define {name} (\S+)f ", text, re.MULTILINE):
                assert float(found) == pytest.approx(value, rel=1e-7)
    assert seen >= 2


#: Field of a struct: words of its comment that say the unit.
FILTER_UNITS = {
    "R": "measurement noise variances, A^2, each positive: 1e-18 .. 1e18",
    "Q": "process noise variances per step, each positive: 1e-18 .. 1e18",
    "u_max": "V: voltages beyond are rejected; 1e-18 .. 1e18",
    "y_max": "A: currents beyond are rejected; 1e-18 .. 1e18",
    "u_held": "V: last accepted voltages",
    "nis_max": "from this mean of the normalised innovation squared on; expected: 2",
}
CONTROLLER_UNITS = {
    "integrator": "speed N m, d and q current V",
    "command_max": "speed reference rad/s, DC link V",
    "v_acting": "V: voltage of the interval that begins now",
    "v_queued": "V: with a sample of delay",
    "sensed": "speed rad/s mechanical, angle rad electrical",
    "delay": "0 or 1",
}
EXAMPLE_UNITS = {
    "TRIP_CURRENT": "A",
    "ZERO_CURRENT": "A",
    "PROBE_CURRENT": "A",
    "PROBE_SPEED": "rad/s per A",
    "UNKNOWN_SPEED": "(rad/s)^2",
    "UNKNOWN_ANGLE": "rad^2",
    "UNKNOWN_FLUX": "Wb^2",
    "SAMPLE_TIME": "s",
}


def test_units_in_headers(made: Made) -> None:
    name = made.drive.name
    for kind in made.drive.filter.kinds:
        header, controller = made.files[f"{name}_{kind}.h"], made.files[f"{name}_{kind}_foc.h"]
        for text, units in ((header, FILTER_UNITS), (controller, CONTROLLER_UNITS)):
            for field, said in units.items():
                comment = re.search(rf"^ +\w+ {field}(?:\[\d\])?; /\* (.*) \*/", text, re.MULTILINE)
                assert comment is not None, field
                assert said in comment[1], field
        states = ", ".join(f"{s['name']} {s['unit']}" for s in made.facts["states"])
        assert f"float32 x[{len(made.facts['states'])}]; /* {states} */" in header
        words = " ".join(header.replace(" * ", " ").split())
        assert "u: v_alpha, v_beta in V, mean over the interval ending now; y: i_alpha, i_beta in A, now." in words
        words = " ".join(controller.replace(" * ", " ").split())
        assert (
            "phase: i_a, i_b in A; command: speed reference rad/s mechanical, DC link V; duty: phases a, b, c, 0..1"
            in words
        )
    example = made.files["example_isr.c"]
    for macro, unit in EXAMPLE_UNITS.items():
        found = re.search(rf"^#define {macro} \S+ /\* (\S+(?: per A)?)(?::|,| \*/)", example, re.MULTILINE)
        assert (found is None) == (macro == "UNKNOWN_FLUX" and name == "paper_spmsm"), macro
        if found is not None:
            assert found[1] == unit, macro
    for words in ("i_a, i_b in A, positive", "DC link in V", "Speed reference in rad/s, mechanical"):
        assert words in example
    for place, unit in enumerate(("rad/s mechanical", "electrical turn", "Hz electrical")):
        assert re.search(rf"words\[{place}\] = .*; +/\* {unit} \*/", example)


def test_tuning_in_the_c_is_the_drive_files(made: Made) -> None:
    """What _init loads: each number by its name, as float32."""
    drive = made.drive
    wanted = {
        **{f"Q[{k}]": v for k, v in enumerate(drive.filter.process_noise)},
        **{f"R[{k}]": v for k, v in enumerate(drive.filter.measurement_noise)},
        **{f"P_0[{k}]": v for k, v in enumerate(drive.filter.initial_covariance)},
        **{f"x_0[{k}]": v for k, v in enumerate(default_initial_state(drive))},
        "u_max": drive.operating_box.voltage,
        "y_max": drive.operating_box.current,
        "tolerance": drive.filter.tolerance,
        "max_iterations": drive.filter.max_iterations,
    }
    for kind in drive.filter.kinds:
        text = made.files[f"{drive.name}_{kind}.c"]
        found = dict(re.findall(r"f->(\w+(?:\[\d\])?) = ([-+.\de]+)f?;", text))
        for name, value in wanted.items():
            assert np.float32(found[name]) == np.float32(value), name
