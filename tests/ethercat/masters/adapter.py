"""SOEM's virtual network adapter, by soemx: SCRIPT INTERFACE READS COUNT COMMAND...

Exchanges process data in cycles of 2 ms. Meanwhile it carries the frames of a TAP interface, in a network of its own, to the device and
back, by EoE, and runs the command in that network as often as READS says: it must print COUNT lines that begin with a bracket, each time.
"""

import ctypes
import fcntl
import os
import struct
import subprocess
import sys
import time

import soemx
from routine import WATCHDOG, WATCHDOG_REGISTER
from soem import PATIENCE, SYNC_MANAGERS

CLONE_NEWNET = 0x40000000
TUNSETIFF, IFF_TAP_WITHOUT_INFO, IFF_UP = 0x400454CA, 0x1002, 1
# Of SyncManager 1: a message waits.
STATUS = SYNC_MANAGERS + 8 + 5
FULL = 0x08
TIMEOUT = 200_000
CYCLE = 0.002
OWN, MASK, DEVICE = "10.7.0.1/24", bytes([255, 255, 255, 0]), bytes([10, 7, 0, 2])

_, interface, reads, count, *command = sys.argv


def ip(words):
    subprocess.run(["ip", *words.split()], check=True)


master = soemx.Master()
master.sdo_read_timeout = master.sdo_write_timeout = PATIENCE
# Its socket stays in the network in which it is opened.
master.open(interface)
assert ctypes.CDLL(None, use_errno=True).unshare(CLONE_NEWNET) == 0, "a network of its own"
tap = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
fcntl.ioctl(tap, TUNSETIFF, struct.pack("16sH22x", b"adapter", IFF_TAP_WITHOUT_INFO))
with open("/proc/sys/net/ipv6/conf/adapter/disable_ipv6", "w") as setting:
    setting.write("1")
ip("link set lo up")
ip("link set adapter up")
ip(f"addr add {OWN} dev adapter")

assert master.config_init() == 1, "one device"
device = master.slaves[0]
assert device.state_check(soemx.PREOP_STATE, PATIENCE) == soemx.PREOP_STATE
eoe = device.eoe()
master.read_state()
master.write_register(device.index, WATCHDOG_REGISTER, WATCHDOG, PATIENCE)
assert eoe.set_ip(DEVICE, MASK, bytes(4), 2_000_000) > 0
master.config_map()
assert device.state_check(soemx.SAFEOP_STATE, PATIENCE) == soemx.SAFEOP_STATE, hex(device.al_status)
device.outputs[:] = bytes(len(device.outputs))
master.exchange_processdata(PATIENCE)
master.state = soemx.OP_STATE
master.write_state()
end = time.monotonic() + 10
while device.state_check(soemx.OP_STATE, 1_000) != soemx.OP_STATE:
    master.exchange_processdata(PATIENCE)
    assert time.monotonic() < end, hex(device.al_status)

cycles = short = sent = received = done = 0
running = None
end = time.monotonic() + 120
following = time.monotonic()
while done < int(reads):
    assert time.monotonic() < end, f"{done} of {reads}, {sent} frames sent, {received} received"
    cycles += 1
    short += master.exchange_processdata(PATIENCE) != 3
    try:
        if eoe.send(os.read(tap, 1514), TIMEOUT) > 0:
            sent += 1
    except BlockingIOError:
        pass
    if master.read_register(device.index, STATUS, 1, PATIENCE)[0] & FULL:
        try:
            os.write(tap, eoe.receive(1600, TIMEOUT))
            received += 1
        except soemx.errors.PacketError:
            # Its first fragments are lost: soemx took them while it waited for a response.
            pass
    if running is None:
        running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    elif running.poll() is not None:
        said = running.stdout.read()
        assert running.returncode == 0, said
        assert len([line for line in said.splitlines() if line.startswith("[")]) == int(count), said
        done, running = done + 1, None
    following = max(following + CYCLE, time.monotonic())
    time.sleep(max(0, following - time.monotonic()))
print(f"{done} reads, {cycles} cycles, {short} short, {sent} frames sent, {received} received")
assert short == 0
master.state = soemx.INIT_STATE
master.write_state()
master.close()
