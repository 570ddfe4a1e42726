"""A Modbus server by pymodbus: server.py WHERE UNIT...

WHERE is a serial device, tcp:PORT for Modbus TCP on the loopback address, or rtu:PORT for RTU over TCP.

Each unit has 64 coils (off), 64 discrete inputs (every third is on), 100 holding registers (0) and 100 input registers, of
which register A of unit U holds 256 * U + A. Units that it does not have are answered 04.
"""

import asyncio
import sys

from pymodbus import FramerType, ModbusDeviceIdentification
from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice


FRAMERS = {"tcp": FramerType.SOCKET, "rtu": FramerType.RTU}


def device(unit: int) -> SimDevice:
    inputs = [256 * unit + address for address in range(100)]
    return SimDevice(
        id=unit,
        simdata=(
            [SimData(0, values=[False] * 64, datatype=DataType.BITS)],
            [SimData(0, values=[bit % 3 == 0 for bit in range(64)], datatype=DataType.BITS)],
            [SimData(0, values=[0] * 100, datatype=DataType.REGISTERS)],
            [SimData(0, values=inputs, datatype=DataType.REGISTERS)],
        ),
    )


async def main() -> None:
    identity = ModbusDeviceIdentification(
        info_name={"VendorName": "peer", "ProductCode": "P1", "MajorMinorRevision": "1.2"}
    )
    devices = [device(int(unit)) for unit in sys.argv[2:]]
    framing, _, port = sys.argv[1].partition(":")
    if framing in FRAMERS:
        address = ("127.0.0.1", int(port))
        server = ModbusTcpServer(devices, framer=FRAMERS[framing], identity=identity, address=address)
    else:
        server = ModbusSerialServer(
            devices, framer=FramerType.RTU, identity=identity, port=sys.argv[1], baudrate=115200
        )
    await server.serve_forever(background=True)
    print("ready", flush=True)
    await server.serving


asyncio.run(main())
