"""The routine with KickCAT.

It reads 1C00h, the assigned PDOs and their mappings entry by entry at each start. An upload in segments it cannot read (2.5
takes the data for their length), so what does not fit into a mailbox is left to the others. It cannot list objects either.
With a second interface the device is in a ring.
"""

import time

import kickcat
import routine
from kickcat import Access, State

# Seconds. As in patience.py.
PATIENCE = 5.0
# Without a second interface it lets its time-out pass after each broadcast, and reads the EEPROM by hundreds of them. But a frame
# that takes longer is lost, and the start with it. A busy machine makes frames late, so a start that fails is begun again, at
# first with the time-out that KickCAT has by itself. The device is not to blame unless it fails with the longest, too.
TIMEOUTS = [0.002] * 4 + [0.002 * 2**nth for nth in range(1, 8)]
# For a single broadcast.
BROADCAST = 0.05


class MainDevice:
    # Of a mailbox of 128 bytes its header, CoE's, SDO's and the length.
    READ_MAX = 128 - 6 - 2 - 4 - 4

    def __init__(self, interface, second=""):
        self.interfaces = interface, second

    def to_pre_op(self):
        *shorter, longest = [PATIENCE] if self.interfaces[1] else TIMEOUTS
        if not any(self.succeeds(timeout) for timeout in shorter):
            self.scan(longest)
        self.link.set_timeout(PATIENCE)
        (self.device,) = self.bus.slaves()

    def succeeds(self, timeout):
        try:
            self.scan(timeout)
        except RuntimeError as error:
            print(f"with a time-out of {timeout} s: {error}", flush=True)
            return False
        return True

    def scan(self, timeout):
        self.begin, self.timeout = time.monotonic(), timeout
        # With a socket of its own: what comes late is not taken for a response to something else.
        self.link = kickcat.create_link(*self.interfaces)
        self.link.set_timeout(timeout)
        self.bus = kickcat.Bus(self.link)
        self.bus.init(routine.WATCHDOG_SECONDS)

    def to_op(self):
        self.bus.create_mapping()
        self.reach(State.SAFE_OP)
        self.bus.process_data_no_check()
        self.reach(State.OPERATIONAL)

    def to_init(self):
        self.reach(State.INIT)

    def reach(self, state):
        self.link.set_timeout(PATIENCE if self.interfaces[1] else BROADCAST)
        self.bus.request_state(state)
        self.link.set_timeout(PATIENCE)
        self.bus.wait_for_state(state, PATIENCE)

    def read(self, index, sub, size):
        return self.bus.read_sdo(self.device, index, sub, Access.PARTIAL, size, PATIENCE)

    def complete(self, index, size):
        return self.bus.read_sdo(self.device, index, 0, Access.COMPLETE, size, PATIENCE)

    def listed(self):
        return None

    def cycle(self, number):
        self.device.set_output_bytes(bytes([number % 256]) * self.device.output_size)
        try:
            self.bus.process_data()
        except RuntimeError as error:
            print(error)
            return False
        return True


if __name__ == "__main__":
    routine.run(MainDevice)
