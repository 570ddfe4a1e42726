"""The routine with SOEM, by soemx."""

import routine
import soemx
from soem import PATIENCE, Soem


class MainDevice(Soem):
    def __init__(self, interface):
        super().__init__(soemx, interface)

    def slow_watchdog(self):
        # Before that it takes the device's mailbox for one that does not work.
        self.master.read_state()
        self.master.write_register(self.device.index, routine.WATCHDOG_REGISTER, routine.WATCHDOG, PATIENCE)

    def reach(self, state):
        self.master.state = state
        self.master.write_state()
        self.wait_for(state)

    def listed(self):
        # It takes the working counter for the number of objects, and gives the first one only.
        (first,) = self.device.sdo_info()
        assert first["index"] == 0x1000
        return None

    def put(self, byte):
        outputs = self.device.outputs
        outputs[:] = byte * len(outputs)

    def exchange(self):
        return self.master.exchange_processdata(PATIENCE)


routine.run(MainDevice)
