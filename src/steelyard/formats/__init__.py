"""Log files of all kinds, read in parts."""

from steelyard.formats.cut import Cut as Cut
from steelyard.formats.cut import parse_log_argument as parse_log_argument
from steelyard.formats.log import Log as Log
from steelyard.formats.register import FORMATS as FORMATS
from steelyard.formats.register import open_log as open_log
