"""What the routine's MainDevices with SOEM have in common: pysoem and soemx call it by the same names."""

import struct

# So long, in us, may the machine do other things.
PATIENCE = 5_000_000
# Starts that may be lost in a row.
STARTS_MAX = 3
# The registers of the four SyncManagers: start, length, control, status, activation, PDI control.
SYNC_MANAGERS = 0x0800
SYNC_MANAGER = struct.Struct("<HHBBBB")
MAILBOXES, PROCESS_DATA = (0, 1), (2, 3)
# The objects that assign PDOs to SyncManagers 2 and 3.
ASSIGNMENTS = (0x1C12, 0x1C13)
# EEPROM: where categories begin, and the one that describes the SyncManagers.
CATEGORIES = 0x0040
SYNC_MANAGER_CATEGORY = 41


class Soem:
    READ_MAX = 1 << 16

    def __init__(self, soem, interface):
        self.soem = soem
        self.master = soem.Master()
        self.master.sdo_read_timeout = self.master.sdo_write_timeout = PATIENCE
        self.master.open(interface)

    def to_pre_op(self):
        # A frame that comes late on a busy machine is lost to SOEM, and so is what it reads from the EEPROM or the state that it asks
        # for: it asks anew, unless the device has refused what is right.
        for _ in range(STARTS_MAX):
            assert self.master.config_init() == 1, "one device"
            self.device = self.master.slaves[0]
            if self.device.state_check(self.soem.PREOP_STATE, PATIENCE) == self.soem.PREOP_STATE:
                break
            code = self.device.al_status
            assert code == 0 or not self.are_right(self.sync_managers(), MAILBOXES), hex(code)
        self.wait_for(self.soem.PREOP_STATE)
        self.slow_watchdog()

    def to_op(self):
        # The same for what it learns of the process data.
        for _ in range(STARTS_MAX):
            self.master.config_map()
            if self.device.state_check(self.soem.SAFEOP_STATE, PATIENCE) == self.soem.SAFEOP_STATE:
                break
            code, found = self.device.al_status, self.sync_managers()
            self.to_pre_op()
            assert not self.are_right(found, PROCESS_DATA), hex(code)
        self.wait_for(self.soem.SAFEOP_STATE)
        self.exchange()
        self.reach(self.soem.OP_STATE)

    def to_init(self):
        self.reach(self.soem.INIT_STATE)

    def sync_managers(self):
        return list(SYNC_MANAGER.iter_unpack(self.register(SYNC_MANAGERS, 4 * SYNC_MANAGER.size)))

    def are_right(self, found, which):
        """Whether these SyncManagers were set up as the device says: by its EEPROM, and process data as long as what is assigned."""
        described = self.described()
        lengths = self.assigned_bytes() if which == PROCESS_DATA else [described[manager][1] for manager in which]
        expected = [(described[manager][0], length, described[manager][2], 1) for manager, length in zip(which, lengths)]
        return [(*found[manager][:3], found[manager][4] & 1) for manager in which] == expected

    def described(self):
        at = CATEGORIES
        while self.word(at) != SYNC_MANAGER_CATEGORY:
            at += 2 + self.word(at + 1)
        words = (self.word(at + 2 + nth) for nth in range(self.word(at + 1)))
        return list(SYNC_MANAGER.iter_unpack(b"".join(word.to_bytes(2, "little") for word in words)))

    def word(self, address):
        return self.eeprom(address) & 0xFFFF

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
