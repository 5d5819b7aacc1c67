"""From measurement to list, in floors of which each rests only on those below.

`fit` (estimators: arrays in, model and uncertainty out) → `exchange` (list ↔ model) →
`proof` (read back, held-out prediction, gate) → `job` (job file, run) → `report` →
`cli`; `machine` is the virtual machine beside `proof`. Import the floor that you need.
"""
