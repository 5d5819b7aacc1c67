"""Bytes of a file as text with plain line ends; refuses what is no text."""

import codecs
import gzip
import re
import zlib
from pathlib import Path

from ._errors import LineError, MeasurementError

# What a file says of itself in its first bytes, where another reader would be needed.
_FOREIGN = (
    (b"PK\x03\x04", "a spreadsheet or zip archive"),
    (b"\xd0\xcf\x11\xe0", "a spreadsheet of the old binary kind"),
    (b"\x89HDF", "an HDF5 file"),
    (b"TDSm", "a TDMS file"),
    (b"%PDF", "a PDF document"),
    (b"{", "a JSON document"),
    (b"<", "an XML or HTML document"),
)
_EXPECTED = (
    "a text table (CSV), a TwinCAT Scope text export, MATLAB, Parquet, an ISO 230-2 run"
    " table, a bed mesh or a height map"
)
# No text holds these; tab, line ends and form feed are allowed.
_CONTROLS = bytes(code for code in range(32) if code not in b"\t\n\f\r")
_CONTROL = re.compile(rb"[%b]" % re.escape(_CONTROLS))
_TEXT = bytes(code for code in range(256) if code not in _CONTROLS)
# What tables of numbers are made of.
_NUMERIC = b"0123456789+-.,;\t\n"
_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


def unpacked(raw: bytes, path: Path) -> bytes:
    """Return the content of a file, unpacked where it is gzip-compressed.

    Raises:
        MeasurementError: If it is empty, damaged, or of a kind that is not read.
    """
    if raw.startswith(b"\x1f\x8b"):
        try:
            raw = gzip.decompress(raw)
        except (OSError, EOFError, zlib.error) as error:
            reason = f"found damaged gzip data ({error}), expected a whole file"
            raise MeasurementError(str(path), reason) from error
    if not raw.strip():
        reason = f"found an empty file, expected {_EXPECTED}"
        raise MeasurementError(str(path), reason)
    for magic, kind in _FOREIGN:
        if raw.startswith(magic):
            reason = f"found {kind}, expected {_EXPECTED}"
            raise MeasurementError(str(path), reason)
    return raw


def decode(raw: bytes, path: Path) -> str:
    """Return the text with plain line ends: by byte order mark, UTF-8, else Latin-1.

    Raises:
        MeasurementError: If the bytes are no text.
    """
    return text_and_words(raw, path)[0]


def text_and_words(raw: bytes, path: Path) -> tuple[str, bytes]:
    """Return the text as `decode`, and the same without digits, signs and separators.

    Of a table little is left of that. Words of letters, blanks and brackets that stand in
    the text stand there as well, and are found sooner; what comes to stand side by side may
    look like others.

    Raises:
        MeasurementError: If the bytes are no text.
    """
    for mark, encoding in _MARKS:
        if raw.startswith(mark):
            text = raw.decode(encoding, errors="replace")
            words = text.encode().translate(None, _NUMERIC)
            break
    else:
        # Taking all else away is faster than looking for one.
        words = raw.translate(None, _NUMERIC)
        control = _CONTROL.search(raw) if words.translate(None, _TEXT) else None
        if control is not None:
            line = raw.count(b"\n", 0, control.start()) + 1
            byte = raw[control.start()]
            found = f"binary data (byte 0x{byte:02X} at offset {control.start()})"
            raise LineError(str(path), line, found, _EXPECTED)
        try:
            text = raw.decode("utf-8")
        except UnicodeDecodeError:
            text = raw.decode("latin-1")
    if "\r" in text:
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    return text, words
