"""The report: one self-contained page, and the terminal's summary."""

from steelyard.report.content import ReportContent as ReportContent
from steelyard.report.sections.register import render as render
from steelyard.report.terminal.terminal import parameters_csv as parameters_csv
from steelyard.report.terminal.terminal import summary as summary
