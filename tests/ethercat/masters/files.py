"""Writes and reads files with SOEM, as the SubDevice's README says: SCRIPT INTERFACE README NAME PASSWORD OTHER LENGTH...

The README's Python is run as it stands there. NAME is for Boot, OTHER for the other states; each is written with each LENGTH.
"""

import random
import re
import sys

import pysoem
import patience  # noqa: F401 for what it sets
from soem import PATIENCE

_, interface, readme, name, password, other, *lengths = sys.argv
password, lengths = int(password), [int(length) for length in lengths]
# What pysoem returns when the device responds with an error.
FOE_ERROR = -5

[snippet] = re.findall(r"```python\n(.*?)```", open(readme).read(), re.DOTALL)
read_me = {}
exec(compile(snippet, readme, "exec"), read_me)
write_firmware = read_me["write_firmware"]


def content(length):
    return random.Random(length).randbytes(length)


master = pysoem.Master()
master.open(interface)
assert master.config_init() == 1, "one device"
device = master.slaves[0]

# The EEPROM says that the mailboxes stay where they are in Boot.
for word in (0x14, 0x16):
    assert device.eeprom_read(word, PATIENCE) == device.eeprom_read(word + 4, PATIENCE) != bytes(4)
for length in lengths:
    write_firmware(device, name, content(length), password)
try:
    write_firmware(device, name, content(500), password + 1)
except RuntimeError as refused:
    assert str(FOE_ERROR) in str(refused), refused
else:
    raise AssertionError("the password does not count")

# Other files, in PreOp.
assert master.config_init() == 1
device = master.slaves[0]
assert device.state_check(pysoem.PREOP_STATE, PATIENCE) == pysoem.PREOP_STATE
for length in lengths:
    written = content(length)
    assert device.foe_write(other, 0, written, PATIENCE) > 0, f"{length} bytes"
    assert device.foe_read(other, 0, max(lengths), PATIENCE) == written, f"{length} bytes"
assert device.foe_write(name, password, b"x", PATIENCE) == FOE_ERROR, "only in Boot"
assert device.foe_read("missing", 0, 100, PATIENCE) == b""
master.close()
