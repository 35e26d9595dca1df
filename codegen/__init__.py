"""Mathematics to code: the operation graph, its layout, one printer a language, one small description a target.

Start at :func:`codegen.generate.generate`, the pipeline from a drive to a folder of files.
"""

from codegen.output.version import __version__

__all__ = ["__version__"]
