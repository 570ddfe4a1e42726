"""The routine with SOEM, by pysoem."""

import pysoem
import routine
from patience import slow_watchdog
from soem import PATIENCE, Soem


class MainDevice(Soem):
    def __init__(self, interface):
        super().__init__(pysoem, interface)

    def slow_watchdog(self):
        slow_watchdog(self.device)

    def register(self, address, size):
        return self.device._fprd(address, size, PATIENCE)

    def eeprom(self, address):
        return int.from_bytes(self.device.eeprom_read(address), "little")

    def reach(self, state):
        self.device.state = state
        self.device.write_state()
        self.wait_for(state)

    def listed(self):
        return {entry.index: len(entry.entries) for entry in self.device.od}

    def put(self, byte):
        self.device.output = byte * len(self.device.output)

    def exchange(self):
        self.master.send_processdata()
        return self.master.receive_processdata(PATIENCE)


routine.run(MainDevice)
