"""The worked slave of a controller by pymodbus: points_server.py PORT

Unit 1 has by Modbus TCP, in holding registers: inputs at 0 (165), 8 integers at 1 to 8 (-4 to 3), 8 floats of 32 bits with the
big end first at 10 to 25 (-1.0, -0.5 ... 2.5), outputs at 100, 4 integers at 101 to 104, 4 floats at 110 to 117, all 0.
"""

import asyncio
import struct
import sys

from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice


def registers(text: str, *values) -> list[int]:
    data = struct.pack(f">{len(values)}{text}", *values)
    return list(struct.unpack(f">{len(data) // 2}H", data))


async def main() -> None:
    holding = [0] * 118
    holding[0] = 165
    holding[1:9] = registers("h", *range(-4, 4))
    holding[10:26] = registers("f", *(nth / 2 - 1 for nth in range(8)))
    bits = [SimData(0, values=[False] * 16, datatype=DataType.BITS)]
    device = SimDevice(
        id=1,
        simdata=(
            bits,
            bits,
            [SimData(0, values=holding, datatype=DataType.REGISTERS)],
            [SimData(0, values=[0], datatype=DataType.REGISTERS)],
        ),
    )
    server = ModbusTcpServer([device], address=("127.0.0.1", int(sys.argv[1])))
    await server.serve_forever(background=True)
    print("ready", flush=True)
    await server.serving


asyncio.run(main())
