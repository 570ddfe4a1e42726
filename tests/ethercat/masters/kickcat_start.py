"""How long KickCAT takes to Op, with one interface and with the time-out that it has by itself."""

import sys
import time

from kickcat_master import MainDevice
from routine import figure

master = MainDevice(sys.argv[1])
master.to_pre_op()
master.to_op()
assert master.cycle(0), "a cycle in Op"
# Without the starts that were begun again.
figure("kickcat_start", round(time.monotonic() - master.begin, 2), "s", 5)
master.to_init()
