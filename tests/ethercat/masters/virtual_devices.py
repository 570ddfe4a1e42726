"""The gateway's four virtual Modbus devices, configured and exchanged with by SOEM: virtual_devices.py INTERFACE VECTORS LATE
BAUD POLLING CYCLE INPUTS OUTPUTS

VECTORS is a file, and LATE one that says how late the simulated line was, in all, as eight bytes of microseconds, the little end
first. Polling time and cycle are in ms. So are INPUTS, within which a value that changes at a device must be seen, and
OUTPUTS, within which one that is sent must be read back. When the first register of the first device has become MIRROR, the
devices begin to change the first of their input registers, to the time of that by this machine's clock.
"""

import os
import random
import sys
import time
import tomllib

import pysoem
from patience import PATIENCE, slow_watchdog

INTERFACE, VECTORS, LATE, *NUMBERS = sys.argv[1:]
BAUD, POLLING, CYCLE, INPUTS, OUTPUTS = map(int, NUMBERS)
MIRROR = 0xBEEF
CHANGES = 12
INPUT_ENTRIES = ["start", "coils", "switches", "in_registers", "out_registers", "end"]
OUTPUT_ENTRIES = ["start", "coils", "out_registers", "end"]

with open(VECTORS, "rb") as file:
    devices = tomllib.load(file)["device"]


def milliseconds():
    return time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1_000_000


class Exchange:
    """Cycles, and how much later than it should the machine lets them and the line come: nobody else answers for that."""

    def __init__(self):
        self.last = milliseconds()
        self.line = os.open(LATE, os.O_RDONLY)
        self.line_late = self.line_now()
        self.late = []

    def line_now(self):
        return int.from_bytes(os.pread(self.line, 8, 0), "little") / 1_000

    def cycle(self):
        master.send_processdata()
        assert master.receive_processdata(PATIENCE) == 3
        time.sleep(CYCLE / 1_000)
        now, line_late = milliseconds(), self.line_now()
        self.late.append((now, max(0, now - self.last - CYCLE - 1) + line_late - self.line_late))
        self.last, self.line_late = now, line_late

    def stalled(self, since):
        self.late = self.late[-20_000:]
        return sum(late for at, late in self.late if at >= since)


def write(index, sub, value, size):
    gateway.sdo_write(index, sub, value.to_bytes(size, "little"))


def read(index, sub):
    return int.from_bytes(gateway.sdo_read(index, sub), "little")


def configure():
    write(0x2000, 1, len(devices), 2)
    for index, device in enumerate(devices, 0x2001):
        ranges = [device[kind] for kind in ("coils", "switches", "in_registers", "out_registers")]
        settings = [device["id"], *(number for both in ranges for number in both)]
        for sub, value in enumerate(settings, 1):
            write(index, sub, value, 2)
        write(index, 10, POLLING, 4)
    write(0x2020, 1, BAUD, 4)
    write(0x2020, 2, 1, 2)
    write(0x2020, 3, 2, 2)
    write(0x2005, 1, 1, 2)
    # The line is opened anew, and discards what comes for a second before it asks.
    time.sleep(1.5)
    assert (read(0x2005, 1), read(0x2005, 2)) == (0, 1)
    for index, device in enumerate(devices, 0x2011):
        layout = [device["input"][name] for name in INPUT_ENTRIES]
        layout += [device["output"][name] for name in OUTPUT_ENTRIES]
        assert [read(index, sub) for sub in range(1, 11)] == layout, f"layout {index:04x}"


def words(values):
    return b"".join(value.to_bytes(2, "big") for value in values)


def until(good, limit, what):
    """Cycles until it is `good`; how many ms that took."""
    begin = milliseconds()
    while not good():
        assert milliseconds() - begin <= limit + exchange.stalled(begin), f"{what} within {limit} ms"
        exchange.cycle()
        watch_inputs()
    return milliseconds() - begin


def watch_inputs():
    """Looks how old a change of a device's first input register is when it is seen."""
    for device, last in zip(devices, seen):
        at = device["input"]["in_registers"]
        value = int.from_bytes(gateway.input[at : at + 2], "big")
        if changing and value != last[0]:
            last[0] = value
            age = (milliseconds() - value) % 65_536
            assert age <= INPUTS + exchange.stalled(milliseconds() - age), f"an input after {age} ms"
            ages.append(age)


master = pysoem.Master()
master.sdo_read_timeout = master.sdo_write_timeout = PATIENCE
master.open(INTERFACE)
assert master.config_init() == 1, "one device"
gateway = master.slaves[0]
slow_watchdog(gateway)
configure()
assert master.config_map() >= 240
assert master.state_check(pysoem.SAFEOP_STATE, PATIENCE) == pysoem.SAFEOP_STATE
outputs = b"".join(bytes(device["write"]["coils_bytes"]) + words(device["write"]["out_registers"]) for device in devices)
outputs = bytearray(outputs.ljust(120, b"\0"))
image = bytes(byte for device in devices for byte in device["input_image"]).ljust(120, b"\0")
gateway.output = bytes(outputs)
exchange, changing, seen, ages, times = Exchange(), False, [], [], []
gateway.state = pysoem.OP_STATE
gateway.write_state()
until(lambda: gateway.state_check(pysoem.OP_STATE, 1_000) == pysoem.OP_STATE, PATIENCE // 1_000, "Op")
until(lambda: gateway.input == image, OUTPUTS, "every byte of the vectors")

seen = [[int.from_bytes(image[place : place + 2], "big")] for place in (device["input"]["in_registers"] for device in devices)]
changing = True
for change in range(CHANGES):
    device, value = random.choice(devices), random.randrange(65_536)
    if change == 0:
        device, value = devices[0], MIRROR
    sent, back = device["output"]["out_registers"], device["input"]["out_registers"]
    outputs[sent : sent + 2] = value.to_bytes(2, "big")
    gateway.output = bytes(outputs)
    good = lambda: gateway.input[back : back + 2] == outputs[sent : sent + 2]
    times.append(until(good, OUTPUTS, "a read-back"))
    pause = milliseconds() + random.randrange(200)
    while milliseconds() < pause:
        exchange.cycle()
        watch_inputs()
assert len(ages) >= 3, "inputs have changed"
print(f"{BAUD} baud, polling {POLLING} ms, cycle {CYCLE} ms: inputs {max(ages)} of {INPUTS} ms, outputs {max(times)} of {OUTPUTS} ms")

write(0x2005, 2, 0, 2)
assert read(0x2005, 2) == 0
gateway.state = pysoem.INIT_STATE
gateway.write_state()
assert gateway.state_check(pysoem.INIT_STATE, PATIENCE) == pysoem.INIT_STATE
master.close()
