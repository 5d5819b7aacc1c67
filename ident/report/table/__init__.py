"""What the page shows of a table: `_body` puts it together.

`_readings` (in display units), `_lines` and `_maps` with `_plane` (the table itself),
`_residuals` and `_spread` (what remains), `_words` (how it was made).
"""
