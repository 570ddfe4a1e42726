"""Starts the Linux program with SOEM: the meter and the relays of its demo by process data, and their configuration kept.

With `long` the images are longer than the 512 bytes of a LAN9252, and the relays lie behind those.
"""

import struct
import sys
import time

import pysoem
from patience import PATIENCE, slow_watchdog, start


LONG = "long" in sys.argv[2:]
BYTES = 1020 if LONG else 120


def assign(gateway):
    """All that SOEM takes: it has the outputs of one device in one frame, and the inputs."""
    for index, pdos in ((0x1C12, (0x1601, 0x1604, 0x1605)), (0x1C13, (0x1A01, 0x1A07, 0x1A08))):
        gateway.sdo_write(index, 0, bytes([0]))
        for sub, pdo in enumerate(pdos, 1):
            gateway.sdo_write(index, sub, pdo.to_bytes(2, "little"))
        gateway.sdo_write(index, 0, bytes([len(pdos)]))


def cycle():
    master.send_processdata()
    return master.receive_processdata(PATIENCE)


def until(good, what):
    end = time.monotonic() + 60
    while not good():
        assert time.monotonic() < end, what
        assert cycle() == 3, "everybody has read and written"
        time.sleep(0.001)


def layout(index):
    """Where a device's values begin: read coils, read input registers, coils to write."""
    return [int.from_bytes(gateway.sdo_read(index, sub), "little") for sub in (2, 4, 8)]


def volts():
    at = layout_of_meter[1]
    return struct.unpack(">f", gateway.input[at : at + 4])[0]


def relays():
    return gateway.input[layout_of_relays[0]]


master = pysoem.Master()
master.sdo_read_timeout = master.sdo_write_timeout = PATIENCE
master.open(sys.argv[1])
gateway = start(master, 2 * BYTES, assign if LONG else None)
assert gateway.name == "mobgate-long"
slow_watchdog(gateway)
assert gateway.sdo_read(0x2005, 2) == bytes([1, 0]), "the slaves of the settings are in use"
layout_of_meter, layout_of_relays = layout(0x2011), layout(0x2013 if LONG else 0x2012)
assert not LONG or layout_of_relays[2] > 512, layout_of_relays
gateway.output = bytes(BYTES)
gateway.state = pysoem.OP_STATE
gateway.write_state()
until(lambda: gateway.state_check(pysoem.OP_STATE, 1_000) == pysoem.OP_STATE, "Op")

until(lambda: 227 < volts() < 233, "the meter's volts")
first = volts()
until(lambda: volts() != first, "they move")
outputs = bytearray(BYTES)
for pattern in (0xA5, 0x00):
    outputs[layout_of_relays[2]] = pattern
    gateway.output = bytes(outputs)
    until(lambda: relays() == pattern, f"relays {pattern:02x}")

if "save" in sys.argv[2:]:
    gateway.sdo_write(0x1010, 1, b"save")
gateway.state = pysoem.INIT_STATE
gateway.write_state()
assert gateway.state_check(pysoem.INIT_STATE, PATIENCE) == pysoem.INIT_STATE
master.close()
