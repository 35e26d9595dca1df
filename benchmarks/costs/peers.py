"""The same step by others: CasADi's own C, SymForce's C++, and C written by hand."""

from __future__ import annotations

import contextlib
import io
import logging
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import casadi as ca

from codegen.ir.covariance import place
from codegen.ir.trig import INSIDE, wrap_listing
from codegen.render.filter import render_port
from codegen.render.printers.c import CPrinter
from codegen.render.trig import sin_cos_text
from codegen.targets.find import default_target
from codegen.targets.numbers import FLOAT32
from costs.counting import Candidate
from costs.plain import Package, ckf_step
from model.schema import Drive
from runtime.firmware.tools import MissingTool

HERE = Path(__file__).parents[1]
EIGEN = Path("/usr/include/eigen3")
#: Input arrays of the step and their lengths.
ARRAYS = {"x": 4, "P": 10, "Q": 4, "R": 2, "u": 2, "y": 2}


def handwritten(iterations: int = 1) -> Candidate:
    """benchmarks/handwritten_ckf.c with the generated filters' sine, cosine and wrapping; ``iterations``: N_max."""
    texts = {name: (HERE / name).read_text(encoding="utf-8") for name in ("handwritten_ckf.h", "handwritten_ckf.c")}
    texts["handwritten_ckf.c"] = f"#define N_MAX {iterations}\n" + texts["handwritten_ckf.c"]
    sources = {"pmsm_port.h": render_port(default_target()), "trig.h": trig_header(), **texts}
    return Candidate("hand-written", "handwritten_ckf", sources)


def trig_header() -> str:
    """Sine, cosine and wrapping as generated, as a header."""
    printer = CPrinter(FLOAT32)
    literal, precision = printer.format_literal, FLOAT32.precision
    parts = [
        '#include "pmsm_port.h"',
        f"#define ROUND {literal(precision.rounding)}",
        f"#define BELOW_PI {literal(precision.below_pi)}",
        f"#define INSIDE {literal(INSIDE)}",
        "static float32 smaller(float32 a, float32 b) { return (a < b) ? a : b; }",
        "static float32 larger(float32 a, float32 b) { return (a > b) ? a : b; }",
        sin_cos_text(printer),
        printer.format_helper(wrap_listing(precision)),
    ]
    return "\n".join(parts) + "\n"


def casadi_c(drive: Drive) -> Candidate:
    """CasADi's C of an SX function of the whole step, with casadi_real float, common subexpressions eliminated."""
    symbols = {name: ca.SX.sym(name, size) for name, size in ARRAYS.items()}
    package = Package(ca.sin, ca.cos, ca.sqrt, ca.floor)
    x, P = ckf_step(package, drive, *(ca.vertsplit(symbol) for symbol in symbols.values()))
    outputs = ca.cse([ca.vertcat(*x), ca.vertcat(*P)])
    function = ca.Function("casadi_ckf", list(symbols.values()), outputs, list(symbols), ["x_new", "P_new"])
    generator = ca.CodeGenerator("casadi_ckf.c", {"casadi_real": "float"})
    generator.add(function)
    wrapper = _wrapper("casadi", drive, "int casadi_ckf(const float **, float **, int *, float *, int);", _CASADI)
    text = generator.dump().replace("#define casadi_int long long int", "#define casadi_int int")
    return Candidate(
        "CasADi's own C (SX, casadi_real float)",
        "casadi",
        {**wrapper, "casadi_ckf.c": text},
        counted="casadi_ckf",
        operations=_casadi_operations(function),
        note="its constants, sin, cos, sqrt and floor stay double: on the M4 double is software",
    )


def _casadi_operations(function: Any) -> Counter[str]:
    names = {
        ca.OP_ADD: "add",
        ca.OP_SUB: "add",
        ca.OP_NEG: "add",
        ca.OP_MUL: "mul",
        ca.OP_TWICE: "mul",
        ca.OP_SQ: "mul",
        ca.OP_DIV: "div",
        ca.OP_INV: "div",
        ca.OP_SQRT: "sqrt",
        ca.OP_SIN: "sincos",
    }
    ids = (function.instruction_id(k) for k in range(function.n_instructions()))
    return Counter(names[op] for op in ids if op in names)


_CASADI = """
    const float *arg[] = { f->x, f->P, f->Q, f->R, u, y };
    float x[4], P[10], *res[] = { x, P };
    int i;
    (void)casadi_ckf(arg, res, 0, 0, 0);
"""


def symforce_cpp(drive: Drive) -> Candidate:
    """SymForce's C++ of the same formulas, Scalar = float, in Eigen's fixed matrices.

    Raises
    ------
    ImportError
        SymForce is not installed.
    MissingTool
        Eigen's headers are not.
    """
    text = _symforce_header(drive)
    if not EIGEN.is_dir():
        raise MissingTool("Eigen/Core", "libeigen3-dev")
    declared = "void symforce_ckf(const float *, const float *, const float *, const float *, const float *, const float *, float *, float *);"  # noqa: E501
    call = "    float x[4], P[10];\n    int i;\n    symforce_ckf(f->x, f->P, f->Q, f->R, u, y, x, P);\n"
    arguments = ", ".join(
        f"*reinterpret_cast<const Eigen::Matrix<float, {size}, 1> *>({name})" for name, size in ARRAYS.items()
    )
    results = "reinterpret_cast<Eigen::Matrix<float, 4, 1> *>(xn), reinterpret_cast<Eigen::Matrix<float, 10, 1> *>(Pn)"
    parameters = ", ".join([*(f"const float *{name}" for name in ARRAYS), "float *xn", "float *Pn"])
    unit = (
        f'#include <cmath>\n#include "symforce_step.h"\nvoid symforce_ckf({parameters})\n'
        f"{{\n    sym::CkfStep<float>({arguments}, {results});\n}}\n"
    )
    return Candidate(
        "SymForce's C++ (Scalar = float)",
        "symforce",
        {**_wrapper("symforce", drive, declared, call), "symforce_step.h": text, "symforce_ckf.c": unit},
        counted="symforce_ckf*",
        # No vector alignment: the matrices lie where the wrapper's arrays lie.
        compiler=(
            *("g++", "-std=gnu++17", "-O2", "-ffp-contract=off", "-DNDEBUG", "-DEIGEN_MAX_STATIC_ALIGN_BYTES=0"),
            *("-fno-strict-aliasing", f"-I{EIGEN}"),
        ),
        note="sinf, cosf and floorf are the platform's",
    )


def _symforce_header(drive: Drive) -> str:
    logging.getLogger("symforce").setLevel(logging.ERROR)
    with contextlib.redirect_stderr(io.StringIO()):
        import symforce.symbolic as sf
        from symforce.codegen import Codegen, CppConfig
        from symforce.values import Values

        symbols = {name: sf.Matrix([sf.Symbol(f"{name}_{k}") for k in range(size)]) for name, size in ARRAYS.items()}
        package = Package(sf.sin, sf.cos, sf.sqrt, sf.floor)
        x, P = ckf_step(package, drive, *(list(symbol.to_storage()) for symbol in symbols.values()))
        outputs = Values(x_new=sf.Matrix(x), P_new=sf.Matrix(P))
        codegen = Codegen(inputs=Values(**symbols), outputs=outputs, config=CppConfig(), name="ckf_step")
        with tempfile.TemporaryDirectory() as scratch:
            made = codegen.generate_function(output_dir=scratch, skip_directory_nesting=True)
            return Path(made.generated_files[0]).read_text(encoding="utf-8")


def _wrapper(name: str, drive: Drive, declared: str, body: str) -> dict[str, str]:
    """A struct, init, reset and step around a function of plain arrays."""
    tuning = drive.filter
    starts = [
        *(f"f->Q[{k}] = {value}f;" for k, value in enumerate(map(float, tuning.process_noise))),
        *(f"f->R[{k}] = {value}f;" for k, value in enumerate(map(float, tuning.measurement_noise))),
    ]
    variances = [f"f->P[{place(k, k)}] = {float(value)}f;" for k, value in enumerate(tuning.initial_covariance)]
    header = f"""#ifndef WRAPPED_H
#define WRAPPED_H
#include "pmsm_port.h"
typedef struct {{ float32 x[4]; float32 P[10]; float32 Q[4]; float32 R[2]; }} {name}_t;
void {name}_init({name}_t *f);
void {name}_reset({name}_t *f);
int {name}_step({name}_t *f, const float32 u[2], const float32 y[2]);
#endif
"""
    source = f"""#include "{name}.h"
{declared}
void {name}_reset({name}_t *f)
{{
    int i;
    for (i = 0; i < 4; i++) {{ f->x[i] = 0.0f; }}
    for (i = 0; i < 10; i++) {{ f->P[i] = 0.0f; }}
    {" ".join(variances)}
}}
void {name}_init({name}_t *f)
{{
    {" ".join(starts)}
    {name}_reset(f);
}}
int {name}_step({name}_t *f, const float32 u[2], const float32 y[2])
{{{body if body.startswith(chr(10)) else chr(10) + body}
    for (i = 0; i < 4; i++) {{ f->x[i] = x[i]; }}
    for (i = 0; i < 10; i++) {{ f->P[i] = P[i]; }}
    return 0;
}}
"""
    return {"pmsm_port.h": render_port(default_target()), f"{name}.h": header, f"{name}.c": source}
