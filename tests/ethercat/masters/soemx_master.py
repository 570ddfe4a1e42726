"""The routine with SOEM, by soemx."""

import routine
import soemx

# As in patience.py.
PATIENCE = 5_000_000


class MainDevice:
    READ_MAX = 1 << 16

    def __init__(self, interface):
        self.master = soemx.Master()
        self.master.sdo_read_timeout = self.master.sdo_write_timeout = PATIENCE
        self.master.open(interface)

    def to_pre_op(self):
        assert self.master.config_init() == 1, "one device"
        self.device = self.master.slaves[0]
        assert self.device.state_check(soemx.PREOP_STATE, PATIENCE) == soemx.PREOP_STATE
        # Before that it takes the device's mailbox for one that does not work.
        self.master.read_state()
        self.master.write_register(self.device.index, routine.WATCHDOG_REGISTER, routine.WATCHDOG, PATIENCE)

    def to_op(self):
        self.master.config_map()
        assert self.device.state_check(soemx.SAFEOP_STATE, PATIENCE) == soemx.SAFEOP_STATE
        self.master.exchange_processdata(PATIENCE)
        self.reach(soemx.OP_STATE)

    def to_init(self):
        self.reach(soemx.INIT_STATE)

    def reach(self, state):
        self.master.state = state
        self.master.write_state()
        assert self.device.state_check(state, PATIENCE) == state, hex(self.device.al_status)

    def read(self, index, sub, size):
        return self.device.sdo_read(index, sub, size)

    def complete(self, index, size):
        return self.device.sdo_read(index, 0, size, ca=True)

    def listed(self):
        # It takes the working counter for the number of objects, and gives the first one only.
        (first,) = self.device.sdo_info()
        assert first["index"] == 0x1000
        return None

    def cycle(self, number):
        outputs = self.device.outputs
        outputs[:] = bytes([number % 256]) * len(outputs)
        return self.master.exchange_processdata(PATIENCE) == self.master.expected_wkc == 3


routine.run(MainDevice)
