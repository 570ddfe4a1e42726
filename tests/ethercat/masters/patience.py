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


def scan(master, count):
    """Finds the devices, until they are `count`."""
    end = time.monotonic() + PATIENCE_S
    while (found := master.config_init()) != count:
        assert time.monotonic() < end, f"{found} devices instead of {count}"
