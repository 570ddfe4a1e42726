"""What a busy machine takes from SOEM, which waits for a frame for some milliseconds only, is done again."""

import time

import pysoem

PATIENCE_S = 30


def patiently(action):
    """Does `action` until no frame is missed."""
    end = time.monotonic() + PATIENCE_S
    while True:
        try:
            return action()
        except pysoem.WkcError:
            if time.monotonic() > end:
                raise


def start(master, size):
    """Finds one device and brings it to SafeOp with at least `size` bytes of process data."""
    end = time.monotonic() + PATIENCE_S
    while True:
        scan(master, 1)
        try:
            if master.config_map() >= size and master.state_check(pysoem.SAFEOP_STATE, 5_000_000) == pysoem.SAFEOP_STATE:
                return master.slaves[0]
        except (pysoem.ConfigMapError, pysoem.MailboxError, pysoem.WkcError):
            pass
        assert time.monotonic() < end, "SafeOp"


def scan(master, count):
    """Finds the devices, until they are `count`."""
    end = time.monotonic() + PATIENCE_S
    while (found := master.config_init()) != count:
        assert time.monotonic() < end, f"{found} devices instead of {count}"
