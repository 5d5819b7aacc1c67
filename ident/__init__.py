"""From measurement to list, in floors of which each rests only on those below.

`core` (the estimator: readings and a stack of effects in, a posterior out) → `fit` (tables, logs
in pieces, joint fits), `volumetric` (errors over three axes), `kinds` (temperature, backlash,
crosstalk), `friction` → `discover` → `exchange` (list ↔ model) → `diagnosis` (what shows the lists
at work on the controller, and probes of its rules), `proof` (read back, held-out prediction,
gate) → `readings` (files of a job in, columns out) → `job` (job file, run) → `report` → `cli`;
`machine` is the virtual machine beside `proof`. Import the floor that you need.

What `axcomp` itself offers stands beside them, in this order: the effects of `fit.joint`,
`_readings` (`read`, to the record of `_recording`; `Friction`), `_library` (`fit`) with
`_write_job` (its files), `_fit_model` with `_parameters` and `_model_fit` (any model),
`_fit_linear` (a linear stack as a differentiable function) with `_linear_solver`. Lists and
models of an axis: `exchange`.
"""
