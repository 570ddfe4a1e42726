"""The worked master of a controller by pymodbus: points_client.py WHERE read|write

WHERE is tcp:PORT, or a serial device. `read` compares inputs, integers and floats of unit 1 with those that points_server.py
has; `write` gives it outputs 77, integers 1000, -1000, 2000, -2000 and floats 0.25, -0.25, 1e6, -1e6, and compares them.
"""

import struct
import sys

from pymodbus import FramerType
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.constants import ExcCodes


def registers(text: str, *values) -> list[int]:
    data = struct.pack(f">{len(values)}{text}", *values)
    return list(struct.unpack(f">{len(data) // 2}H", data))


def good(response):
    assert not response.isError(), response
    return response


def read(client) -> None:
    def holding(address: int, count: int) -> list[int]:
        return good(client.read_holding_registers(address, count=count, device_id=1)).registers

    assert holding(0, 1) == [165], holding(0, 1)
    assert holding(1, 8) == registers("h", *range(-4, 4)), holding(1, 8)
    assert holding(10, 16) == registers("f", *(nth / 2 - 1 for nth in range(8))), holding(10, 16)
    assert holding(0, 9) == [165] + registers("h", *range(-4, 4))
    response = client.read_holding_registers(9, count=1, device_id=1)
    assert response.isError() and response.exception_code == ExcCodes.ILLEGAL_ADDRESS, response


def write(client) -> None:
    good(client.write_register(100, 77, device_id=1))
    integers = registers("h", 1000, -1000, 2000, -2000)
    good(client.write_registers(101, integers, device_id=1))
    floats = registers("f", 0.25, -0.25, 1e6, -1e6)
    good(client.write_registers(110, floats, device_id=1))
    response = good(client.read_holding_registers(100, count=5, device_id=1))
    assert response.registers == [77, *integers], response
    response = good(client.read_holding_registers(110, count=8, device_id=1))
    assert response.registers == floats, response


def main() -> None:
    where, what = sys.argv[1:]
    if where.startswith("tcp:"):
        client = ModbusTcpClient("127.0.0.1", port=int(where.removeprefix("tcp:")), timeout=10, retries=0)
    else:
        client = ModbusSerialClient(where, framer=FramerType.RTU, baudrate=115200, timeout=10, retries=3)
    with client:
        {"read": read, "write": write}[what](client)
    print("all compared")


main()
