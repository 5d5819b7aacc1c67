"""Signals of a recording: motion from positions, delays, faults of a current.

Arrays in, typed results out; no files, and NumPy and SciPy only. What is worked
on here `axcomp.data.measurements` reads. Positions are in mm or °, times in s, currents
in any unit.

* `read_clock`: sample time, jumps and continuous segments.
* `filtered_motion`, `smoothed_motion`: velocity and acceleration with their noise.
* `zero_phase`, `central_differences`, `decimate`: the same steps for all columns of a fit.
* `estimate_delay`: channels that are late.
* `estimate_instrument`, `aligned_error`: an external instrument beside the encoder of a
  moving axis; `standing`: where it does not move.
* `find_polarity`, `find_saturation`, `without_spikes`, `examine`: what a recording of a
  current is worth.
* `signs_at_one_place`: how many signs of an acceleration stand at one place each.
* `wild_readings`: those far from all others.
* `median`, `quantile`: NumPy's for one array, faster.
"""

from ._aligned import (
    AlignedError as AlignedError,
    InstrumentClock as InstrumentClock,
    aligned_error as aligned_error,
    encoder_spline as encoder_spline,
    first_motion as first_motion,
    last_direction as last_direction,
    standing as standing,
    travel_direction as travel_direction,
)
from ._clock import Clock as Clock, Jump as Jump, read_clock as read_clock
from ._current import (
    Polarity as Polarity,
    Saturation as Saturation,
    find_polarity as find_polarity,
    find_saturation as find_saturation,
    without_spikes as without_spikes,
)
from ._delay import (
    Delay as Delay,
    estimate_delay as estimate_delay,
)
from ._errors import SignalError as SignalError
from ._examine import (
    Examination as Examination,
    Finding as Finding,
    Kind as Kind,
    examine as examine,
)
from ._filter import (
    bandwidth as bandwidth,
    central_differences as central_differences,
    decimate as decimate,
    zero_phase as zero_phase,
)
from ._instrument import estimate_instrument as estimate_instrument
from ._motion import (
    Motion as Motion,
    filtered_motion as filtered_motion,
    motion_of as motion_of,
    smoothed_motion as smoothed_motion,
)
from ._noise import (
    CLOSER as CLOSER,
    MANY as MANY,
    NORMAL as NORMAL,
    independent as independent,
    noise_of as noise_of,
    repeatability as repeatability,
    resolution as resolution,
    scatter_of as scatter_of,
)
from ._order import median as median, quantile as quantile
from ._strokes import signs_at_one_place as signs_at_one_place
from ._wild import MOST_WILD as MOST_WILD, wild_readings as wild_readings
