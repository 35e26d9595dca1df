"""Everything that runs: the estimator over generated code, the NumPy reference, the proof, the command line.

>>> from runtime import load
>>> f = load("paper_spmsm", filter="ckf")
>>> f.state_names
('i_alpha', 'i_beta', 'omega', 'theta')
"""

from runtime.estimator import Estimator, Trace, load
from runtime.system.errors import UserError

__all__ = ["Estimator", "Trace", "UserError", "load"]
