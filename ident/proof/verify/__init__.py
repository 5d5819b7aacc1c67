"""A controller's log against its lists: what it does with each compensation.

Each compensation is a *channel* that gives what is added along the motion of the log,
also under changes that a controller may make (`Change`). The search compares such
hypotheses by how well they explain what was logged, the noise being estimated, and what
each costs (a description length); the judge puts the best into words.
"""

from ._channel import AbstractChannel as AbstractChannel, Change as Change
from ._judge import Verdict as Verdict
from ._lists import channel_of as channel_of
from ._motion import LogMotion as LogMotion
from ._verify import Verification as Verification, verify_log as verify_log
