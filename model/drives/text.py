"""The text of files that people write: UTF-8, with or without a byte order mark, any line ends."""

from __future__ import annotations

from pathlib import Path


class EncodingError(ValueError):
    """A file is no UTF-8; the message says where and what to do."""


def read_text(path: Path) -> str:
    r"""Read a text file; neither a byte order mark nor \r\n makes another text of it.

    Parameters
    ----------
    path : Path

    Returns
    -------
    str
        With \n at the ends of lines: what is hashed is the same on every system.

    Raises
    ------
    OSError
        If it cannot be read.
    EncodingError
        If it is no UTF-8, nor UTF-16 with a byte order mark.
    """
    raw = path.read_bytes()
    encoding = "utf-16" if raw[:2] in {b"\xff\xfe", b"\xfe\xff"} else "utf-8-sig"
    try:
        return raw.decode(encoding).replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise EncodingError(
            f"line {line} is no UTF-8 (byte 0x{raw[error.start]:02x}); save the file as UTF-8"
        ) from None
