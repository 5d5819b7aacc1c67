"""What the page shows of a table: `_body` puts it together.

`_fitted` (table and readings in display units), `_lines` and `_maps` (the table itself),
`_residuals` (what remains), `_words` (how it was made, and whether its deviations are honest).
"""
