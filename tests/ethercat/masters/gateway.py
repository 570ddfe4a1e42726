"""Starts the gateway with SOEM: scan, objects, complete access, OP, its watchdog, and back."""

import sys
import time

import pysoem
import patience  # noqa: F401 for what it sets

NAME = "mobgate"
BYTES = 120
VENDOR, PRODUCT = (int(text) for text in sys.argv[2:4])


def reach(state, tries=40):
    """Asks for a state, exchanging process data meanwhile, as it takes outputs to reach OP."""
    gateway.state = state
    gateway.write_state()
    for _ in range(tries):
        exchange()
        if gateway.state_check(state, 20_000) == state:
            return
    raise AssertionError(f"state {gateway.state}, {pysoem.al_status_code_to_string(gateway.al_status)}")


def exchange():
    master.send_processdata()
    return master.receive_processdata(100_000)


def refused(action, code):
    try:
        action()
    except pysoem.SdoError as error:
        assert error.abort_code == code, hex(error.abort_code)
    else:
        raise AssertionError(f"not refused with {code:#x}")


master = pysoem.Master()
master.open(sys.argv[1])
assert master.config_init() == 1, "one device"
gateway = master.slaves[0]
assert (gateway.name, gateway.man, gateway.id) == (NAME, VENDOR, PRODUCT), "what the EEPROM says"

# Objects: expedited, normal, refused, complete.
assert int.from_bytes(gateway.sdo_read(0x1018, 1), "little") == VENDOR
assert gateway.sdo_read(0x1008, 0).decode() == "mobgate EtherCAT to Modbus gateway"
gateway.sdo_write(0x2001, 1, (17).to_bytes(2, "little"))
assert gateway.sdo_read(0x2001, 1) == bytes([17, 0])
refused(lambda: gateway.sdo_write(0x2001, 1, (248).to_bytes(2, "little")), 0x06090031)
refused(lambda: gateway.sdo_read(0x5000, 0), 0x06020000)
refused(lambda: gateway.sdo_write(0x1018, 1, bytes(4)), 0x06010002)
record = gateway.sdo_read(0x2001, 0, ca=True)
assert len(record) == 24 and record[:4] == bytes([10, 0, 17, 0]), record.hex()
mapping = gateway.sdo_read(0x1600, 0, size=512, ca=True)
assert len(mapping) == 2 + 4 * BYTES, "in segments"
gateway.sdo_write(0x2001, 0, record[:2] + bytes([18, 0]) + record[4:], ca=True)
assert gateway.sdo_read(0x2001, 1) == bytes([18, 0])

# The object dictionary as the device lists it.
objects = {entry.index: entry for entry in gateway.od}
assert objects[0x2021].name == b"InputBuffer" and len(objects[0x2021].entries) == BYTES + 1
assert objects[0x2001].entries[10].bit_length == 32

# Process data.
assert master.config_map() >= 2 * BYTES
assert (len(gateway.output), len(gateway.input)) == (BYTES, BYTES)
assert master.state_check(pysoem.SAFEOP_STATE, 500_000) == pysoem.SAFEOP_STATE
gateway.output = bytes(BYTES)
assert master.expected_wkc == 3
reach(pysoem.OP_STATE)
for cycle in range(1, 500):
    gateway.output = bytes((cycle + byte) % 256 for byte in range(BYTES))
    assert exchange() == 3
    time.sleep(0.001)

# The watchdog: no outputs for longer than its 100 ms.
time.sleep(0.3)
master.read_state()
assert gateway.state == pysoem.SAFEOP_STATE + pysoem.STATE_ERROR, gateway.state
assert gateway.al_status == 0x001B, hex(gateway.al_status)
gateway.state = pysoem.SAFEOP_STATE + pysoem.STATE_ACK
gateway.write_state()
reach(pysoem.OP_STATE)
assert exchange() == 3

# And back.
for state in (pysoem.SAFEOP_STATE, pysoem.PREOP_STATE, pysoem.INIT_STATE):
    gateway.state = state
    gateway.write_state()
    assert gateway.state_check(state, 500_000) == state
master.close()
