"""Starts the Linux program with SOEM: the meter and the relays of its demo by process data, and their configuration kept."""

import struct
import sys
import time

import pysoem
from patience import PATIENCE, slow_watchdog, start


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
gateway = start(master, 240)
assert gateway.name == "mobgate"
slow_watchdog(gateway)
assert gateway.sdo_read(0x2005, 2) == bytes([1, 0]), "the slaves of the settings are in use"
layout_of_meter, layout_of_relays = layout(0x2011), layout(0x2012)
gateway.output = bytes(120)
gateway.state = pysoem.OP_STATE
gateway.write_state()
until(lambda: gateway.state_check(pysoem.OP_STATE, 1_000) == pysoem.OP_STATE, "Op")

until(lambda: 227 < volts() < 233, "the meter's volts")
first = volts()
until(lambda: volts() != first, "they move")
outputs = bytearray(120)
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
