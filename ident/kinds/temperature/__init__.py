"""Temperature: a line over the position that follows a sensor."""

from .._kind import Kind

KIND = Kind(
    name="temperature",
    words="a line over the position that follows a sensor",
    holder="axis",
    prefix="lr_param.temp_comp",
    activation="lr_param.temp_comp",
    keyword="TEMP",
    variable="V.A.TEMP_COMP_CURR",
    channel="TEMPC::actual_offset",
    conventions=("temperature_",),
    cycles=("lr_param.temp_comp_n_cycles", 19),
    resized=None,
    noun="the temperature",
    manual="lr_param.temp_comp_manual_activation",
    by_plc=True,
)
