"""Brings two devices of two bytes each way to OP and exchanges process data with SOEM."""

import sys

import pysoem
import patience  # noqa: F401 for what it sets

master = pysoem.Master()
master.open(sys.argv[1])
assert master.config_init() == 2, "two devices"
assert [device.name for device in master.slaves] == ["simple", "simple"]
assert master.config_map() == 8, "bytes of the process image"
assert master.state_check(pysoem.SAFEOP_STATE, 500_000) == pysoem.SAFEOP_STATE
master.slaves[1].output = bytes([0x12, 0x34])
master.send_processdata()
master.receive_processdata(10_000)
master.state = pysoem.OP_STATE
master.write_state()
assert master.state_check(pysoem.OP_STATE, 500_000) == pysoem.OP_STATE
for _ in range(100):
    master.send_processdata()
    assert master.receive_processdata(100_000) == 2 * 2, "only the outputs count: nobody has written inputs"
master.state = pysoem.INIT_STATE
master.write_state()
master.close()
