"""What MainDevices in other programs do with the gateway: SCRIPT INTERFACE ENTRIES CYCLES RESTARTS
[SECOND-INTERFACE].

Each script has a MainDevice with these methods, and gives the class to `run`:

* `to_pre_op()` and `to_op()`, one after the other from Init; `to_init()`
* `read(index, sub, size)` and `complete(index, size)`, in PreOp: the bytes of an entry, and those of a whole object by complete
  access
* `cycle(number)`: exchanges process data; whether all working counters are as they should be
* `listed()`: the objects that the device lists, and how many sub-indices each has; none if the MainDevice cannot ask that
* `READ_MAX`: how many bytes it can read at once

ENTRIES is a file with a line for each entry that can be read in PreOp: index, sub-index, bytes, `=`, `<` (when there may be
fewer) or `b` (a bit), and in hexadecimal digits the value if it is known. It comes from the device's table, and what is read is held
against it.
"""

import itertools
import sys
import time

# Six seconds without outputs stop them, in the register's units of 100 us: what a busy machine takes from a MainDevice must not.
WATCHDOG_REGISTER = 0x0420
WATCHDOG_SECONDS = 6.0
WATCHDOG = int(10_000 * WATCHDOG_SECONDS).to_bytes(2, "little")
# What is longer than a mailbox comes in segments.
MAILBOX = 128


def entries_of(path):
    objects = {}
    with open(path) as file:
        for line in file:
            index, sub, size, kind, *known = line.split()
            known = bytes.fromhex(known[0]) if known else None
            objects.setdefault(int(index, 16), {})[int(sub)] = (int(size), kind, known)
    return objects


def whole_of(values, kinds):
    """Values as they lie in a complete access: eight bits that follow each other in a byte, all others in bytes of their own."""
    whole = b""
    for is_bit, group in itertools.groupby(zip(values, kinds), lambda pair: pair[1] == "b"):
        parts = [value for value, _ in group]
        if is_bit:
            number = sum((bit[0] & 1) << nth for nth, bit in enumerate(parts))
            parts = [number.to_bytes((len(parts) + 7) // 8, "little")]
        whole += b"".join(parts)
    return whole


def read_objects(master, objects):
    """Reads every entry, and objects with sub-indices as a whole too. How many of each, and how many came in segments."""
    read, complete, segmented = 0, 0, 0
    for index, entries in objects.items():
        values = {}
        for sub, (size, kind, known) in entries.items():
            if size > master.READ_MAX:
                continue
            value = values[sub] = master.read(index, sub, size)
            fits = len(value) <= size if kind == "<" else len(value) == size
            assert fits, f"{index:04x}:{sub:02x} has {len(value)} bytes of {size}"
            assert known is None or value == known, f"{index:04x}:{sub:02x} is {value.hex()}, not {known.hex()}"
            read += 1
            segmented += len(value) > MAILBOX
        # The others cannot be read, or have no sub-indices.
        if len(entries) == 1 or list(entries) != list(range(len(entries))):
            continue
        # Sub-index 0 takes two bytes of a complete access, and says how many others there are.
        count = values[0][0]
        entries = [entries[sub] for sub in range(1, count + 1)]
        kinds = [kind for _, kind, _ in entries]
        size = 2 + len(whole_of([bytes(size) for size, _, _ in entries], kinds))
        if size > master.READ_MAX:
            continue
        whole = master.complete(index, size)
        parts = bytes([count, 0]) + whole_of([values[sub] for sub in range(1, count + 1)], kinds)
        assert len(whole) == len(parts), f"{index:04x} has {len(whole)} bytes of {len(parts)}"
        # Unless it is one of those that change by themselves.
        assert whole == parts or whole != master.complete(index, size), f"{index:04x}: {whole.hex()} is not {parts.hex()}"
        complete += 1
        segmented += size > MAILBOX
    return read, complete, segmented


def check_list(listed, objects):
    if listed is None:
        return
    assert set(objects) <= set(listed), f"not listed: {[f'{index:04x}' for index in set(objects) - set(listed)]}"
    for index, entries in objects.items():
        assert listed[index] >= max(entries), f"{index:04x} has sub-indices up to {max(entries)}"


def run(make):
    interface, path, cycles, restarts, *second = sys.argv[1:]
    cycles, restarts, objects = int(cycles), int(restarts), entries_of(path)
    master = make(interface, *second)
    begin = time.monotonic()
    master.to_pre_op()
    master.to_op()
    start = time.monotonic() - begin
    assert master.cycle(0), "the first cycle in Op"
    master.to_init()

    master.to_pre_op()
    begin = time.monotonic()
    read, complete, segmented = read_objects(master, objects)
    reading = time.monotonic() - begin
    master.to_op()
    begin = time.monotonic()
    short = sum(not master.cycle(number) for number in range(1, cycles + 1))
    cycling = time.monotonic() - begin
    master.to_init()

    begin = time.monotonic()
    for restart in range(restarts):
        master.to_pre_op()
        master.to_op()
        assert master.cycle(restart), f"a cycle in Op after restart {restart}"
        master.to_init()
    restarting = time.monotonic() - begin
    # Sub-indices that are left out are errors to SOEM, which it keeps: that comes last.
    master.to_pre_op()
    check_list(master.listed(), objects)
    master.to_init()
    print(f"start {start:.2f} s; {read} entries, {complete} objects completely, {segmented} in segments, {reading:.2f} s; "
          f"{cycles} cycles, {cycling:.2f} s; {restarts} restarts, {restarting:.2f} s", flush=True)
    name = sys.argv[0].rsplit("/", 1)[-1].removesuffix("_master.py")
    figure(f"{name}_start", round(start, 2), "s", 5)
    figure(f"{name}_short", short, f"of {cycles}", 0)
    assert short == 0, f"{short} of {cycles} cycles have a short working counter"


def figure(name, value, unit, target):
    print(f"figure {name} {value} {unit} <={target} {'ok' if value <= target else 'short'}", flush=True)
