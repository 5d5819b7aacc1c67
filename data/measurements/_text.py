"""Bytes of a file as text with plain line ends; refuses what is no text."""

import codecs
import contextlib
import dataclasses
import gzip
import re
import zlib
from pathlib import Path

from ._errors import LineError, MeasurementError, damaged

# What a file says of itself in its first bytes, where another reader would be needed.
_FOREIGN = (
    (b"PK\x03\x04", "a spreadsheet or zip archive"),
    (b"\xd0\xcf\x11\xe0", "a spreadsheet of the old binary kind"),
    (b"%PDF", "a PDF document"),
    (b"<", "an XML or HTML document"),
    (b"\0\0\0\0", "MATLAB data of version 4"),
)
_SCOPE_PROJECTS = (".svdx", ".svbx", ".svb", ".tcscopex")
"""Recordings and projects of TwinCAT Scope, which it exports as text."""
_EXPECTED = (
    "a text table (CSV), a TwinCAT Scope text export, MATLAB, Parquet, HDF5, TDMS, an"
    " ISO 230-2 run table, a bed mesh or a height map"
)
# No text holds these; tab, line ends and form feed are allowed.
_CONTROLS = bytes(code for code in range(32) if code not in b"\t\n\f\r")
_CONTROL = re.compile(rb"[%b]" % re.escape(_CONTROLS))
_TEXT = bytes(code for code in range(256) if code not in _CONTROLS)
_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
# Umlauts of MS-DOS between letters, which are quotation marks on Windows, and its micrometre.
_DOS = re.compile(rb"[A-Za-z][\x81\x84\x94][a-z]|(?<![A-Za-z])\xe6m(?![A-Za-z])")
# Other signs for what a number or a blank is made of: minus, blanks that do not break.
_SIGNS = (("\u2212", "-"), ("\u00a0", " "), ("\u202f", " "), ("\u2009", " "))


@dataclasses.dataclass(frozen=True)
class Text:
    """A text with plain line ends.

    Attributes:
        text: The text.
        encoding: As Python names it.
    """

    text: str
    encoding: str


def unpacked(raw: bytes, path: Path) -> bytes:
    """Return the content of a file, unpacked where it is gzip-compressed.

    Raises:
        MeasurementError: If it is empty, damaged, or of a kind that is not read.
    """
    if raw.startswith(b"\x1f\x8b"):
        try:
            raw = gzip.decompress(raw)
        except (OSError, EOFError, zlib.error) as error:
            raise damaged(path, "gzip", error) from error
    if not raw.strip():
        reason = f"found an empty file, expected {_EXPECTED}"
        raise MeasurementError(str(path), reason)
    for magic, kind in _FOREIGN:
        if raw.startswith(magic):
            advice = ": save the sheet as CSV" if "spreadsheet" in kind else ""
            advice = ": save it with -v7" if "MATLAB" in kind else advice
            if path.suffix.casefold() in _SCOPE_PROJECTS:
                kind = "a recording or project of TwinCAT Scope"
                advice = ": export the recording there as text (CSV)"
            reason = f"found {kind}, expected {_EXPECTED}{advice}"
            raise MeasurementError(str(path), reason)
    return raw


def decode(raw: bytes, path: Path) -> Text:
    """Return the text: by byte order mark, UTF-8, UTF-16 without mark, else Windows.

    Raises:
        MeasurementError: If the bytes are no text.
    """
    encoding = next((name for mark, name in _MARKS if raw.startswith(mark)), "")
    if not encoding and raw[1:200:2].count(0) > len(raw[1:200:2]) // 2:
        encoding = "utf-16-le"
    elif not encoding and raw[:200:2].count(0) > len(raw[:200:2]) // 2:
        encoding = "utf-16-be"
    if encoding:
        text = raw.decode(encoding, errors="replace")
    else:
        # Taking all else away is faster than looking for one.
        control = _CONTROL.search(raw) if raw.translate(None, _TEXT) else None
        if control is not None:
            line = raw.count(b"\n", 0, control.start()) + 1
            byte = raw[control.start()]
            found = f"binary data (byte 0x{byte:02X} at offset {control.start()})"
            raise LineError(str(path), line, found, _EXPECTED)
        text, encoding = _of_bytes(raw)
    if "\r" in text:
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    if not text.isascii():
        for sign, letter in _SIGNS:
            text = text.replace(sign, letter)
    return Text(text, encoding)


def _of_bytes(raw: bytes) -> tuple[str, str]:
    with contextlib.suppress(UnicodeDecodeError):
        return raw.decode(), "utf-8"
    encoding = "cp850" if _DOS.search(raw) else "cp1252"
    with contextlib.suppress(UnicodeDecodeError):
        return raw.decode(encoding), encoding
    return raw.decode("latin-1"), "latin-1"
