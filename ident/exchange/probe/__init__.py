"""Probe lists: one plateau per compensation (`_probe`), and what to read (`_probe_text`)."""
