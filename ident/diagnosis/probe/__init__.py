"""Probe lists: one plateau per compensation (`_probe`), what to read (`_probe_text`).

`_nc`: blocks of NC programs that leave every compensation as it was.
"""
