"""What the report shows of a plane table."""

from ...report._table_body import table_body as body

__all__ = ["body"]
