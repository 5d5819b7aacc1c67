"""One folder per compensation: all that is special about it, on top of the estimator.

* `temperature`, `backlash`, `crosstalk`: curves of few columns (`core.regress`).
"""
