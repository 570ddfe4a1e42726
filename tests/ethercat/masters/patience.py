"""Lets SOEM wait: it takes a frame that is some milliseconds late for lost, and on a busy machine many are.

And brings one device to SafeOp.
"""

import pysoem

# So long, in us, may the machine do other things.
PATIENCE = 5_000_000

for what in ("ret", "safe", "eeprom", "tx_mailbox", "rx_mailbox", "state"):
    setattr(pysoem.settings.timeouts, what, PATIENCE)


def start(master, size):
    """The one device, in SafeOp with at least `size` bytes of process data."""
    assert master.config_init() == 1, "one device"
    assert master.config_map() >= size
    assert master.state_check(pysoem.SAFEOP_STATE, PATIENCE) == pysoem.SAFEOP_STATE
    return master.slaves[0]
