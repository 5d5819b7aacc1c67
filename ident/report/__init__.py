"""The report of a job: one HTML page that needs no network, and its plots as SVG."""

from ._overview import write_picture as write_picture
from ._second import (
    SecondMeasurement as SecondMeasurement,
    SecondMeasurementError as SecondMeasurementError,
)
from ._write import write_report as write_report
