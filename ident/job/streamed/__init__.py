"""Table fits to logs too large for memory: read in pieces, as often as the fit asks for it."""

from ._fit import StreamedFitted as StreamedFitted, fit_log_plan as fit_log_plan
from ._proof import prove_streamed as prove_streamed
from ._readings import LogReadings as LogReadings
from ._route import in_pieces as in_pieces
