"""Lets SOEM wait: it takes a frame that is some milliseconds late for lost, and on a busy machine many are."""

import pysoem

# So long, in us, may the machine do other things.
PATIENCE = 5_000_000

for what in ("ret", "safe", "eeprom", "tx_mailbox", "rx_mailbox", "state"):
    setattr(pysoem.settings.timeouts, what, PATIENCE)
