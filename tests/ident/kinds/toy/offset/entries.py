"""``kw.offset`` ↔ `Constant`."""

from typing import final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from axcomp.data.lists import ListFile
from axcomp.ident.exchange import LIST_UNITS, Reading
from axcomp.ident.exchange._capacity import ANY_LIST, ListTarget
from axcomp.ident.kinds._protocol import AbstractEntries, Axes
from axcomp.models import AbstractOffset, Rows

from . import KIND

VALUE = f"{KIND.prefix}.value"


@final
class Constant(AbstractOffset):
    """Adds the same everywhere."""

    value: Float[Array, ""]

    def offset(self, rows: Rows, axes: tuple[int, ...]) -> Float[Array, " t"]:
        return jnp.full(rows.position.shape[1], self.value)


@final
class OffsetEntries(AbstractEntries):
    """``kw.offset.value`` in list units."""

    kind = KIND
    models = (Constant,)
    value = VALUE

    def is_in(self, listing: ListFile) -> bool:
        return listing.get(VALUE) is not None

    def model(self, listing: ListFile, axis: int, reading: Reading) -> Constant:
        return Constant(jnp.asarray((listing.integer(VALUE) or 0) / LIST_UNITS))

    def to_list(
        self, model: Constant, masters: Axes = (), target: ListTarget = ANY_LIST
    ) -> dict[str, int | str]:
        return {VALUE: round(float(np.asarray(model.value)) * LIST_UNITS)}


ENTRIES = OffsetEntries()
