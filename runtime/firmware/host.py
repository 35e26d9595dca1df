"""The host's run of the harness: every word of every step, the E that link E-F compares with."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.estimator.compiler import build_library
from runtime.firmware.build import harness_sources
from runtime.firmware.recording import Recording
from runtime.firmware.subject import Subject


def run_on_host(subject: Subject, recording: Recording) -> NDArray[Any]:
    """(steps, words) of uint32: what each step leaves, in the order of ``subject.words``."""
    library = ctypes.CDLL(str(build_library(harness_sources(subject, recording, "host"), {})))
    words = np.zeros((recording.steps, len(subject.words)), dtype=np.uint32)
    library.harness_run(words.ctypes.data_as(ctypes.c_void_p))
    return words
