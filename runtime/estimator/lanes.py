"""The batch runner in C: the generated lane form, compiled for this processor when a batch first needs it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from runtime.estimator.compiler import build_library, open_library, wide_vectors
from runtime.estimator.folder import GeneratedFolder

LANES_RUNNER = Path(__file__).with_name("lanes_runner.c")

#: Vector instructions of this processor. The next two change no bit: they say that nobody reads errno or the
#: floating-point exception flags, which would keep roots and comparisons out of vectors. The last keeps GCC 12 from
#: pairing neighbouring expressions: what comes of it is vfmaddsub, a contraction, in spite of -ffp-contract=off.
USUAL = ("-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-fno-tree-slp-vectorize")
#: The same in the widest registers there are.
OPTIMISATION = (*USUAL, *wide_vectors())


def open_lanes(folder: GeneratedFolder, kind: str, ffi: Any, optimisation: tuple[str, ...] = OPTIMISATION) -> Any:
    """Open a library with ``lanes_run`` and ``lanes_group``.

    Parameters
    ----------
    folder : GeneratedFolder
    kind : str
        Filter kind.
    ffi : cffi.FFI
        Which has declared the two functions already.
    optimisation : tuple of str
        Compiler flags.
    """
    prefix = f"{folder.drive}_{kind}"
    headers = {f"{prefix}.h": folder.text(f"{prefix}.h"), "pmsm_port.h": folder.text("pmsm_port.h")}
    generated = {f"{prefix}_lanes{end}": folder.text(f"host/{prefix}_lanes{end}") for end in (".h", ".c")}
    defines = {
        "FILTER": prefix,
        "HEADER": f'"{prefix}.h"',
        "LANES_HEADER": f'"{prefix}_lanes.h"',
        "COVARIANCE": folder.module.COVARIANCE,
    }
    if hasattr(folder.module, "SANE_LIMIT"):  # the literal form has no guards
        defines["GUARDED"] = "1"
    runner = {"lanes_runner.c": LANES_RUNNER.read_text(encoding="utf-8")}
    return open_library(ffi, build_library({**headers, **generated, **runner}, defines, optimisation))
