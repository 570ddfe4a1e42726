"""Prints what ethercat-mcp's reader finds in an ESI file: a line for each device, PDO, mapped entry, object and entry of a record."""

import sys

from ethercat_mcp.esi_parser import ESIParser


def hexadecimal(text):
    return text.removeprefix("0x")


read = ESIParser().load(sys.argv[1])
print("vendor", hexadecimal(read["vendor"]["id"]), read["vendor"]["name"])
for device in read["devices"]:
    print("device", device["name"], hexadecimal(device["product_code"]), hexadecimal(device["revision"]))
    for pdo in device["pdos"]["rx"] + device["pdos"]["tx"]:
        manager = "None" if pdo["sm"] is None else f"Some({pdo['sm']})"
        print("PDO", hexadecimal(pdo["index"]), f"{pdo['name']}, SyncManager {manager}")
        for entry in pdo["entries"]:
            at = f"{hexadecimal(entry['index'])}:{entry['subindex'] or 0:02X}"
            print(at, entry["bit_length"], entry["name"] or "")
    for item in device["object_dictionary"]:
        print("object", hexadecimal(item["index"]), item["name"])
        for entry in item["subindexes"]:
            # 0 is the number of entries; an array has its type for all of them.
            if entry["subindex"]:
                at = f"{hexadecimal(item['index'])}:{entry['subindex']:02X}"
                print(at, entry["bit_size"], entry["name"], entry["access"])
