"""Temperature: a line over the position that follows a sensor.

Read in this order: `plan` (alone and with other compensations), with `_alone` (readings, law and
lag of a line alone), `_line` (what comes out), `_law` (table and program for the PLC), `_draft`
and `_result`. The other modules are the parts that every compensation has.
"""

from .._kind import Kind

KIND = Kind(
    name="temperature",
    holder="axis",
    prefix="lr_param.temp_comp",
    activation="lr_param.temp_comp",
    keyword="TEMP",
    channel="TEMPC::actual_offset",
    conventions=("temperature_",),
    follows=frozenset({"position", "temperature"}),
    cycles=("lr_param.temp_comp_n_cycles", 19),
    partial=True,
    often_open=True,
    manual="lr_param.temp_comp_manual_activation",
    by_plc=True,
)
