"""The routine with SOEM, by soemx."""

import routine
import soemx
from soem import PATIENCE, STARTS_MAX, Soem


class MainDevice(Soem):
    def __init__(self, interface):
        super().__init__(soemx, interface)

    def slow_watchdog(self):
        # Before that it takes the device's mailbox for one that does not work.
        self.master.read_state()
        self.master.write_register(self.device.index, routine.WATCHDOG_REGISTER, routine.WATCHDOG, PATIENCE)

    def register(self, address, size):
        return self.master.read_register(self.device.index, address, size, PATIENCE)

    def eeprom(self, address):
        return self.master.read_eeprom(self.device.index, address, PATIENCE)

    def reach(self, state):
        self.master.state = state
        self.master.write_state()
        self.wait_for(state)

    def sdo(self, index, sub, size, **how):
        # Its own time-outs are fixed: a message that is late for them is lost, which has no abort code.
        for _ in range(STARTS_MAX - 1):
            try:
                return super().sdo(index, sub, size, **how)
            except soemx.errors.SdoError as error:
                if error.abort_code:
                    raise
        return super().sdo(index, sub, size, **how)

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
