"""Exchanges process data with one device in Op for some seconds, with a cycle of 1 ms: cycles.py INTERFACE SECONDS"""

import sys
import time

import pysoem
from patience import PATIENCE, start

CYCLE_NS = 1_000_000

master = pysoem.Master()
master.open(sys.argv[1])
device = start(master, 240)
# What the machine takes from us must not stop the outputs.
device.set_watchdog("processdata", 6_000)
device.output = bytes(len(device.output))
device.state = pysoem.OP_STATE
device.write_state()
due, short, trips = time.monotonic_ns(), 0, []
end = due + int(sys.argv[2]) * 1_000_000_000
while due < end:
    begin = time.perf_counter_ns()
    master.send_processdata()
    short += master.receive_processdata(PATIENCE) != 3
    trips.append(time.perf_counter_ns() - begin)
    due = max(due + CYCLE_NS, time.monotonic_ns())
    time.sleep(max(0, due - time.monotonic_ns()) / 1e9)
assert device.state_check(pysoem.OP_STATE, 1_000_000) == pysoem.OP_STATE
trips.sort()
middle, most = (trips[int(len(trips) * part)] // 1_000 for part in (0.5, 0.99))
print(f"{len(trips)} cycles, {short} without a full working counter; there and back {middle} us, 99 of 100 within {most} us")
device.state = pysoem.INIT_STATE
device.write_state()
master.close()
