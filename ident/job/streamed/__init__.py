"""Table fits to logs too large for memory: read in pieces, as often as the fit asks for it."""

from ._draft import fit_log as fit_log
from ._readings import LogReadings as LogReadings, in_pieces as in_pieces
