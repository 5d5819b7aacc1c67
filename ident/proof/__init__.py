"""Why a list can be trusted: held-out prediction, the gate, and what a controller shows.

Read `_figures` (how large an error is, and what the list that was fitted without a reading
leaves of that), `_dynamics` (the motion that a table adds), `_gate` (what it may do), `axis` (all
that acts on one axis, judged together), `_circle` (what friction does to a circle). Folders:
`verify` (a controller's log against its lists), `doctor` (measurements without and with the
lists).

The circular test, `doctor` and `verify` are imported when they are first asked for: most jobs
need none of them.
"""

from typing import TYPE_CHECKING

from .._lazy import importer
from ._dynamics import GateTable as GateTable
from ._figures import (
    ErrorFigures as ErrorFigures,
    ErrorTally as ErrorTally,
    HeldOut as HeldOut,
    RunTable as RunTable,
    error_figures as error_figures,
    groups_of_passes as groups_of_passes,
    groups_of_runs as groups_of_runs,
    held_out as held_out,
    run_variance as run_variance,
)
from ._gate import (
    GateCheck as GateCheck,
    GateLimits as GateLimits,
    choose_cycles as choose_cycles,
    gate_check as gate_check,
    judge as judge,
    reversal_checks as reversal_checks,
    reversal_dynamics as reversal_dynamics,
)

if TYPE_CHECKING:
    from ._circle import CircularTest as CircularTest, circular_test as circular_test
    from .doctor import (
        Diagnosis as Diagnosis,
        Measured as Measured,
        diagnose as diagnose,
        driving_axes as driving_axes,
        not_judged as not_judged,
        unlisted as unlisted,
    )
    from .verify import (
        Verdict as Verdict,
        Verification as Verification,
        turns_in_log as turns_in_log,
        verify_log as verify_log,
    )

__getattr__ = importer(__name__)
