"""The routine with SOEM, by soemx."""

import time

import routine
import soemx
from soem import PATIENCE, SYNC_MANAGERS, Soem

# So long, in us, may a message that is late be on its way.
LATE = 500_000


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
        return self.anew(lambda: super(MainDevice, self).sdo(index, sub, size, **how))

    def anew(self, ask):
        """What `ask` returns. soemx waits 20 ms to send or receive a message, whatever its time-outs are set to, and would take a response
        that comes later for that to its next question about the same object: it asks anew when none can come any more."""
        end = time.monotonic() + PATIENCE / 1e6
        while True:
            try:
                return ask()
            except (soemx.errors.SdoError, soemx.errors.SdoInfoError) as error:
                code = getattr(error, "abort_code", 0)
                if code or time.monotonic() > end:
                    error.add_note(f"abort code {code}, mailboxes {self.register(SYNC_MANAGERS, 16).hex()}")
                    raise
            self.drain()

    def drain(self):
        try:
            while self.device.mbx_receive(timeout=LATE):
                pass
        except soemx.errors.SoemxError:
            pass

    def listed(self):
        # It takes the working counter for the number of objects, and gives the first one only; none where the list comes late.
        (first,) = self.anew(self.list_of_objects)
        assert first["index"] == 0x1000
        return None

    def list_of_objects(self):
        found = self.device.sdo_info()
        if not found:
            raise soemx.errors.SdoInfoError("the list came late")
        return found

    def put(self, byte):
        outputs = self.device.outputs
        outputs[:] = byte * len(outputs)

    def exchange(self):
        return self.master.exchange_processdata(PATIENCE)


routine.run(MainDevice)
