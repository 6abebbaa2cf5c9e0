"""From a raw recording to clean motion on a uniform clock."""

from steelyard.measurement.prepare import prepare as prepare
from steelyard.measurement.processing import Processing as Processing
from steelyard.measurement.quality import Quality as Quality
from steelyard.measurement.recording import Recording as Recording
from steelyard.measurement.run import Block as Block
from steelyard.measurement.run import Run as Run
from steelyard.measurement.run import RunData as RunData
