"""What the routine's MainDevices with SOEM have in common: pysoem and soemx call it by the same names."""

# So long, in us, may the machine do other things.
PATIENCE = 5_000_000
# Starts that may be lost in a row.
STARTS_MAX = 3


class Soem:
    READ_MAX = 1 << 16

    def __init__(self, soem, interface):
        self.soem = soem
        self.master = soem.Master()
        self.master.sdo_read_timeout = self.master.sdo_write_timeout = PATIENCE
        self.master.open(interface)

    def to_pre_op(self):
        # A frame that comes late on a busy machine is lost to SOEM, and so is the state that it asks for: it asks anew, unless the
        # device has refused something.
        for _ in range(STARTS_MAX):
            assert self.master.config_init() == 1, "one device"
            self.device = self.master.slaves[0]
            if self.device.state_check(self.soem.PREOP_STATE, PATIENCE) == self.soem.PREOP_STATE:
                break
            assert self.device.al_status == 0, hex(self.device.al_status)
        self.wait_for(self.soem.PREOP_STATE)
        self.slow_watchdog()

    def to_op(self):
        self.master.config_map()
        self.wait_for(self.soem.SAFEOP_STATE)
        self.exchange()
        self.reach(self.soem.OP_STATE)

    def to_init(self):
        self.reach(self.soem.INIT_STATE)

    def wait_for(self, state):
        assert self.device.state_check(state, PATIENCE) == state, hex(self.device.al_status)

    def read(self, index, sub, size):
        return self.device.sdo_read(index, sub, size)

    def complete(self, index, size):
        return self.device.sdo_read(index, 0, size, ca=True)

    def cycle(self, number):
        self.put(bytes([number % 256]))
        return self.exchange() == self.master.expected_wkc == 3
