"""What the report shows of a cross table."""

from ...report._table_body import table_body as body

__all__ = ["body"]
