"""Friction as a job handles every compensation: recording → law → list → proof."""

from ._draft import plan_friction as plan_friction
from ._result import (
    FrictionResult as FrictionResult,
    FrictionView as FrictionView,
    LawCurve as LawCurve,
    choice_sentence as choice_sentence,
)
