"""Reads the settings with SOEM, changes a rule and writes them back, as docs/ethercat.md says: SCRIPT INTERFACE DOCUMENT

The document's Python is run as it stands there, but for the interface's name and the rule: unit 1 is left out of it, and then is not
reached any more.
"""

import re
import sys
import time

import pysoem
import patience  # noqa: F401 for what it sets
from soem import PATIENCE

_, interface, document = sys.argv
OPEN, ANSWERED = 255, 1
READ_INPUT_REGISTER = bytes([4, 0, 0, 0, 1])


def in_pre_op():
    assert master.config_init() == 1, "one device"
    device = master.slaves[0]
    assert device.state_check(pysoem.PREOP_STATE, PATIENCE) == pysoem.PREOP_STATE
    return device


def answered(unit):
    gateway.sdo_write(0x2033, 1, bytes([unit]) + READ_INPUT_REGISTER)
    end = time.monotonic() + 30
    while (state := gateway.sdo_read(0x2033, 2)[0]) == OPEN:
        assert time.monotonic() < end, "a request comes to its end"
        time.sleep(0.01)
    return state == ANSWERED


master = pysoem.Master()
master.sdo_read_timeout = master.sdo_write_timeout = PATIENCE
master.open(interface)
gateway = in_pre_op()
assert answered(1) and answered(1), "by the rule of before"
before = gateway.foe_read("mobgate.conf", 0, 100_000, PATIENCE)
assert b"route ecat 1-247" in before and b"argon2" not in before, before
for name, content in (("mobgate.conf", before + b"prot x\n"), ("mobgate.log", b"x"), ("other", b"x")):
    assert gateway.foe_write(name, 0, content, PATIENCE) < 0, name
assert gateway.foe_read("mobgate.conf", 0, 100_000, PATIENCE) == before, "nothing has changed"
master.close()

[snippet] = re.findall(r"```python\n(.*?)```", open(document).read(), re.DOTALL)
assert '"eth0"' in snippet and "route ecat 1-100" in snippet
snippet = snippet.replace('"eth0"', repr(interface)).replace("route ecat 1-100", "route ecat 2-100")
exec(compile(snippet, document, "exec"), {})

master.open(interface)
gateway = in_pre_op()
after = gateway.foe_read("mobgate.conf", 0, 100_000, PATIENCE)
assert after == before.replace(b"route ecat 1-247", b"route ecat 2-100"), after
assert not answered(1), "no rule leads to it any more"
log = gateway.foe_read("mobgate.log", 0, 100_000, PATIENCE)
assert b"EtherCAT" in log and b"mobgate.conf is in force and saved" in log, log
frames = gateway.foe_read("capture.pcapng", 0, 100_000, PATIENCE)
assert frames.startswith(bytes([0x0A, 0x0D, 0x0D, 0x0A])) and len(frames) > 200, frames
master.close()
