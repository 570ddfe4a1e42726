"""What the routine's MainDevices with SOEM have in common: pysoem and soemx call it by the same names."""

# So long, in us, may the machine do other things.
PATIENCE = 5_000_000
# Starts that may be lost in a row.
STARTS_MAX = 3
# The length registers of the SyncManagers of the process data, and the objects that assign PDOs to these.
SYNC_MANAGER_LENGTHS = (0x0812, 0x081A)
ASSIGNMENTS = (0x1C12, 0x1C13)


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
        # The same for frames that set up a SyncManager, which is then refused: its length is another one.
        for _ in range(STARTS_MAX):
            self.master.config_map()
            if self.device.state_check(self.soem.SAFEOP_STATE, PATIENCE) == self.soem.SAFEOP_STATE:
                break
            code, lengths = self.device.al_status, self.lengths_set_up()
            self.to_pre_op()
            assert lengths != self.assigned_bytes(), hex(code)
        self.wait_for(self.soem.SAFEOP_STATE)
        self.exchange()
        self.reach(self.soem.OP_STATE)

    def to_init(self):
        self.reach(self.soem.INIT_STATE)

    def lengths_set_up(self):
        return [int.from_bytes(self.register(manager, 2), "little") for manager in SYNC_MANAGER_LENGTHS]

    def assigned_bytes(self):
        """Bytes of the PDOs that are assigned to each SyncManager, as the device says."""
        return [sum(self.pdo_bits(pdo) for pdo in self.numbers(assignment, 2)) // 8 for assignment in ASSIGNMENTS]

    def pdo_bits(self, pdo):
        return sum(entry & 0xFF for entry in self.numbers(pdo, 4))

    def numbers(self, index, size):
        (count,) = self.read(index, 0, 1)
        return [int.from_bytes(self.read(index, sub, size), "little") for sub in range(1, count + 1)]

    def wait_for(self, state):
        assert self.device.state_check(state, PATIENCE) == state, hex(self.device.al_status)

    def read(self, index, sub, size):
        return self.sdo(index, sub, size)

    def complete(self, index, size):
        return self.sdo(index, 0, size, ca=True)

    def sdo(self, index, sub, size, **how):
        return self.device.sdo_read(index, sub, size, **how)

    def cycle(self, number):
        self.put(bytes([number % 256]))
        return self.exchange() == self.master.expected_wkc == 3
