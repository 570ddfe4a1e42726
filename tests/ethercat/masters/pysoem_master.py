"""The routine with SOEM, by pysoem."""

import pysoem
import routine
from patience import PATIENCE, slow_watchdog


class MainDevice:
    READ_MAX = 1 << 16

    def __init__(self, interface):
        self.master = pysoem.Master()
        self.master.sdo_read_timeout = self.master.sdo_write_timeout = PATIENCE
        self.master.open(interface)

    def to_pre_op(self):
        assert self.master.config_init() == 1, "one device"
        self.device = self.master.slaves[0]
        assert self.device.state_check(pysoem.PREOP_STATE, PATIENCE) == pysoem.PREOP_STATE
        slow_watchdog(self.device)

    def to_op(self):
        self.master.config_map()
        assert self.device.state_check(pysoem.SAFEOP_STATE, PATIENCE) == pysoem.SAFEOP_STATE
        self.master.send_processdata()
        self.master.receive_processdata(PATIENCE)
        self.reach(pysoem.OP_STATE)

    def to_init(self):
        self.reach(pysoem.INIT_STATE)

    def reach(self, state):
        self.device.state = state
        self.device.write_state()
        assert self.device.state_check(state, PATIENCE) == state, hex(self.device.al_status)

    def read(self, index, sub, size):
        return self.device.sdo_read(index, sub, size)

    def complete(self, index, size):
        return self.device.sdo_read(index, 0, size, ca=True)

    def listed(self):
        return {entry.index: len(entry.entries) for entry in self.device.od}

    def cycle(self, number):
        self.device.output = bytes([number % 256]) * len(self.device.output)
        self.master.send_processdata()
        return self.master.receive_processdata(PATIENCE) == self.master.expected_wkc == 3


routine.run(MainDevice)
