"""Ethernet frames and addresses by EoE with SOEM, by soemx: SCRIPT INTERFACE LENGTH...

The device returns each frame as it came.
"""

import random
import sys
import time

import soemx
from soem import PATIENCE

_, interface, *lengths = sys.argv
# How long soemx waits for a message; it returns at once when there is one.
TIMEOUT = 500_000
ADDRESS, MASK, GATEWAY = bytes([10, 1, 2, 3]), bytes([255, 255, 0, 0]), bytes([10, 1, 0, 1])


def again(ask, good, what):
    """Asks until the answer is good: on a busy machine a message may come later than soemx waits."""
    end = time.monotonic() + 60
    while True:
        try:
            answer = ask()
            if good(answer):
                return answer
        except soemx.errors.SoemxError as error:
            answer = error
        assert time.monotonic() < end, f"{what}: {answer}"


master = soemx.Master()
master.open(interface)
assert master.config_init() == 1, "one device"
device = master.slaves[0]
assert device.state_check(soemx.PREOP_STATE, PATIENCE) == soemx.PREOP_STATE
eoe = device.eoe()

again(lambda: eoe.set_ip(ADDRESS, MASK, GATEWAY, TIMEOUT), lambda result: result > 0, "set_ip")
found = again(lambda: eoe.get_ip(TIMEOUT), lambda found: found is not None, "get_ip")
# It gives what lies there up to the next zero, whatever that belongs to.
there = [ADDRESS + MASK + GATEWAY, MASK + GATEWAY, GATEWAY]
assert list(found) == [part.split(bytes(1))[0] for part in there], found


def echo(sent):
    assert eoe.send(sent, TIMEOUT) > 0
    return eoe.receive(1600, TIMEOUT)


for length in map(int, lengths):
    sent = random.Random(length).randbytes(length)
    again(lambda: echo(sent), lambda back: back == sent, f"{length} bytes")
master.close()
