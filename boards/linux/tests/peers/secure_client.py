"""A client with TLS: secure_client.py PEER PORT CA CERTIFICATE KEY

PEER is pymodbus or pysunspec2. Reads registers 2 and 3 of unit 1 at 127.0.0.1, then writes 5 to register 4; pysunspec2 finds the
models of a SunSpec device instead of reading. Prints what came of each.
"""

import asyncio
import ssl
import sys

PEER, PORT, CA, CERTIFICATE, KEY = sys.argv[1:]


def by_pymodbus() -> None:
    from pymodbus import FramerType
    from pymodbus.client import AsyncModbusTcpClient
    from pymodbus.transport import CommParams, CommType

    class Client(AsyncModbusTcpClient):
        """Its own client with TLS leaves the header of Modbus TCP out."""

        def __init__(self, context: ssl.SSLContext) -> None:
            self.comm_params = CommParams(
                comm_type=CommType.TLS,
                host="127.0.0.1",
                sslctx=context,
                port=int(PORT),
                comm_name="secure",
                timeout_connect=30,
            )
            AsyncModbusTcpClient.__init__(self, "", framer=FramerType.SOCKET, retries=0)

    async def run() -> None:
        context = ssl.create_default_context(cafile=CA)
        context.load_cert_chain(CERTIFICATE, KEY)
        client = Client(context)
        assert await client.connect(), "no connection"
        response = await client.read_holding_registers(2, count=2, device_id=1)
        print("read", response.exception_code if response.isError() else response.registers)
        response = await client.write_register(4, 5, device_id=1)
        print("write", response.exception_code if response.isError() else "done")
        client.close()

    asyncio.run(run())


def by_pysunspec2() -> None:
    from sunspec2.modbus.client import SunSpecModbusClientDeviceTCP
    from sunspec2.modbus.modbus import ModbusClientException

    files = {"cafile": CA, "certfile": CERTIFICATE, "keyfile": KEY}
    device = SunSpecModbusClientDeviceTCP(1, "127.0.0.1", int(PORT), timeout=30, tls=True, **files)
    device.scan()
    print("maker", device.common[0].Mn.value)
    device.connect()
    try:
        device.write(4, b"\x00\x05")
        print("write done")
    except ModbusClientException as refused:
        print("write refused", refused)
    device.disconnect()


{"pymodbus": by_pymodbus, "pysunspec2": by_pysunspec2}[PEER]()
