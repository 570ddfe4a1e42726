"""How long KickCAT takes to Op at one cable."""

import sys
import time

from kickcat_master import MainDevice

master = MainDevice(sys.argv[1])
master.to_pre_op()
master.to_op()
assert master.cycle(0), "a cycle in Op"
# Without the starts that were begun again. Most of it is what KickCAT waits, so there is no target.
took = time.monotonic() - master.begin
print(f"with a time-out of {master.timeout} s it took\nfigure kickcat_start_at_one_cable {took:.2f} s - ok", flush=True)
master.to_init()
