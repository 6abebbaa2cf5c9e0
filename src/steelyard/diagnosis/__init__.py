"""Checks: what is wrong with a log, and the line of the robot file that corrects it."""

from steelyard.diagnosis.case import Case as Case
from steelyard.diagnosis.examine import Diagnosis as Diagnosis
from steelyard.diagnosis.examine import examine as examine
from steelyard.diagnosis.finding import Edit as Edit
from steelyard.diagnosis.finding import Finding as Finding
from steelyard.diagnosis.finding import Fix as Fix
from steelyard.diagnosis.finding import Severity as Severity
