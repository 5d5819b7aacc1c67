"""MATLAB files of versions 5 to 7.2: vectors of one length are the columns.

Written for damaged files: SciPy's reader (1.17) trusts the sizes in a file and can end
the process on one that was altered. Here every size is checked against the bytes that
are there. See "MAT-File Format", The MathWorks, for the layout.
"""

import dataclasses
import math
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..errors import AxcompError
from ._errors import MeasurementError
from ._table import Table
from ._vectors import Array, table_of_arrays

_NUMBERS = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
}
_TEXTS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16"}
_MATRIX, _COMPRESSED = 14, 15
_CLASSES = {1: "cells", 3: "an object", 5: "a sparse matrix", 16: "a function"}
_STRUCT, _CHAR = 2, 4
_NUMERIC = range(6, 16)
_COMPLEX = 0x0800
_DEPTH = 20
_EXPECTED = "a MATLAB file with vectors of numbers"


class DamagedMat(AxcompError, ValueError):
    """The bytes do not follow the format; the message says what and where."""


def is_mat(raw: bytes) -> bool:
    """Whether the bytes begin like a MATLAB file of versions 5 to 7.2."""
    return raw.startswith(b"MATLAB 5.0")


def read_mat(path: Path, raw: bytes) -> Table:
    """Return the vectors of a MATLAB file as columns; see `table_of_arrays`.

    Fields of structures are named ``structure.field``.

    Raises:
        MeasurementError: If the file is damaged or holds no vector.
    """
    try:
        arrays = list(_variables(raw))
    except DamagedMat as error:
        reason = f"found damaged MATLAB data ({error}), expected {_EXPECTED}"
        raise MeasurementError(str(path), reason) from error
    return table_of_arrays(path, "MATLAB", arrays, _EXPECTED)


def _variables(raw: bytes) -> Iterator[Array]:
    """Yield the variables of a file of version 5 to 7.2, fields as ``name.field``.

    Raises:
        DamagedMat: If a size or a type does not fit.
    """
    mark = raw[126:128]
    if mark not in (b"IM", b"MI"):
        msg = "no mark of the byte order at byte 126"
        raise DamagedMat(msg)
    reader = _Reader(raw, 128, len(raw), "<" if mark == b"IM" else ">")
    while reader.at < reader.end:
        kind, body = reader.element()
        if kind == _COMPRESSED:
            try:
                unpacked = zlib.decompress(body.raw[body.at : body.end])
            except zlib.error as error:
                msg = f"compressed data: {error}"
                raise DamagedMat(msg) from error
            kind, body = _Reader(unpacked, 0, len(unpacked), body.order).element()
        if kind != _MATRIX:
            msg = f"an element of type {kind} in place of a variable"
            raise DamagedMat(msg)
        yield from _matrix(body, None, 0)


@dataclasses.dataclass
class _Reader:
    """A range of bytes, read element by element."""

    raw: bytes
    at: int
    end: int
    order: str

    def element(self) -> tuple[int, "_Reader"]:
        """Return type and content of the next element, and step over it."""
        if self.at + 8 > self.end:
            msg = f"the end of the data at byte {self.end}"
            raise DamagedMat(msg)
        kind, size = struct.unpack_from(f"{self.order}2I", self.raw, self.at)
        if kind >> 16:  # small: size and type share a word, up to 4 bytes behind it
            kind, size, start, step = kind & 0xFFFF, kind >> 16, self.at + 4, 8
            if size > 4:
                msg = f"a short element of {size} bytes at byte {self.at}"
                raise DamagedMat(msg)
        else:
            start = self.at + 8
            step = 8 + (size if kind == _COMPRESSED else -(-size // 8) * 8)
        if start + size > self.end:
            left = self.end - start
            msg = f"an element of {size} bytes where {left} are left"
            raise DamagedMat(msg)
        self.at = min(self.at + step, self.end)
        return kind, _Reader(self.raw, start, start + size, self.order)

    def array(self) -> np.ndarray:
        """Return the next element as numbers."""
        kind, body = self.element()
        if kind not in _NUMBERS:
            msg = f"an element of type {kind} in place of numbers"
            raise DamagedMat(msg)
        form = np.dtype(self.order + _NUMBERS[kind])
        count = (body.end - body.at) // form.itemsize
        return np.frombuffer(self.raw, form, count, body.at)

    def bytes(self) -> tuple[int, bytes]:
        """Return type and bytes of the next element."""
        kind, body = self.element()
        return kind, self.raw[body.at : body.end]


def _matrix(reader: _Reader, name: str | None, depth: int) -> Iterator[Array]:
    """Yield one variable, or the fields of one structure."""
    if reader.at == reader.end:  # an empty array may be written as nothing
        yield Array(name or "", None, "empty")
        return
    flags, shape = reader.array(), reader.array()
    if flags.size < 1 or not 2 <= shape.size <= 32 or min(shape.tolist()) < 0:
        msg = "an array without a proper shape"
        raise DamagedMat(msg)
    stored = reader.bytes()[1].decode("latin-1")
    name = stored if name is None else name
    kind, sizes = int(flags[0]) & 0xFF, tuple(shape.tolist())
    if not name.isprintable():
        msg = "a name that cannot be printed"
        raise DamagedMat(msg)
    if name.startswith("__"):
        return
    if kind in _NUMERIC:
        values = reader.array()
        if int(flags[0]) & _COMPLEX:
            yield Array(name, None, "complex numbers")
        elif values.size != math.prod(sizes):
            msg = f"'{name}' holds {values.size} values for shape {sizes}"
            raise DamagedMat(msg)
        else:
            yield Array(name, values.reshape(sizes, order="F"))
    elif kind == _CHAR:
        coding, text = reader.bytes()
        words = text.decode(_TEXTS.get(coding, "latin-1"), errors="replace")
        yield Array(name, None, f"text '{words[:40]}'")
    elif kind == _STRUCT and math.prod(sizes) == 1 and depth < _DEPTH:
        yield from _fields(reader, name, depth)
    elif kind == _STRUCT:
        yield Array(name, None, "a list of structures")
    else:
        yield Array(name, None, _CLASSES.get(kind, f"class {kind}"))


def _fields(reader: _Reader, name: str, depth: int) -> Iterator[Array]:
    widths = reader.array()
    width = int(widths[0]) if widths.size else 0
    names = reader.bytes()[1]
    if not 0 < width <= 256:
        msg = f"names of fields of {width} bytes"
        raise DamagedMat(msg)
    for at in range(0, len(names), width):
        field = names[at : at + width].split(b"\0")[0].decode("latin-1")
        kind, body = reader.element()
        if kind != _MATRIX:
            msg = f"field '{field}' of type {kind}"
            raise DamagedMat(msg)
        yield from _matrix(body, f"{name}.{field}", depth + 1)
