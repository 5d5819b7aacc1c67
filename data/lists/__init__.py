"""Compensation, axis and start-up lists: text, parameters, checks; plain Python.

* `ListFile`: a list as the file holds it, byte for byte, and what it says.
* `new_list`: the strict writer.
* `registry`: every parameter of the manuals, as data.
* `check`: what is wrong with one list, or with a set of them.

Imports neither NumPy nor JAX: the commands that only read lists start at once.
"""

from ._check import check as check
from ._check_lists import EXTERNAL_LIMITS as EXTERNAL_LIMITS
from ._compare import (
    Change as Change,
    Comparison as Comparison,
    CurveChange as CurveChange,
    compare as compare,
)
from ._curves import (
    DEFAULT_RULES as DEFAULT_RULES,
    SIGNS as SIGNS,
    CurveRules as CurveRules,
    OffsetCurve as OffsetCurve,
    offset_curves as offset_curves,
)
from ._entry import Entry as Entry, Rows as Rows, TextRemark as TextRemark
from ._finding import Finding as Finding, Level as Level
from ._format import (
    EntryValueError as EntryValueError,
    UnknownEntryError as UnknownEntryError,
)
from ._listfile import ListFile as ListFile, Value as Value
from ._names import full_name as full_name
from ._parameter import Parameter as Parameter
from ._registry import (
    BuildError as BuildError,
    Registry as Registry,
    add_parameters as add_parameters,
    build_has as build_has,
    parse_build as parse_build,
    registry as registry,
)
from ._remarks import RemarkCode as RemarkCode
from ._values import parse_real as parse_real
from ._write import new_list as new_list
