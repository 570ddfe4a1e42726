"""Lets SOEM wait: it takes a frame that is some milliseconds late for lost, and on a busy machine many are.

Lets outputs wait as well, and brings one device to SafeOp.
"""

import pysoem
from routine import WATCHDOG, WATCHDOG_REGISTER
from soem import PATIENCE

for what in ("ret", "safe", "eeprom", "tx_mailbox", "rx_mailbox", "state"):
    setattr(pysoem.settings.timeouts, what, PATIENCE)


def slow_watchdog(device):
    """What the machine takes from us must not stop the outputs. `set_watchdog` itself would wait for 4 ms only."""
    device._fpwr(WATCHDOG_REGISTER, WATCHDOG, PATIENCE)


def start(master, size, configure=None):
    """The one device, in SafeOp with at least `size` bytes of process data; in PreOp it was set up by `configure`."""
    assert master.config_init() == 1, "one device"
    master.slaves[0].config_func = configure and (lambda _: configure(master.slaves[0]))
    assert master.config_map() >= size
    assert master.state_check(pysoem.SAFEOP_STATE, PATIENCE) == pysoem.SAFEOP_STATE
    return master.slaves[0]
