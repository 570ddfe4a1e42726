//! The console by USB: a serial port (CDC-ACM).

use embassy_futures::join::join;
use embassy_rp::peripherals::USB;
use embassy_rp::usb::Driver;
use embassy_usb::class::cdc_acm::{BufferedReceiver, CdcAcmClass, Sender, State};
use embassy_usb::{Builder, Config, UsbDevice};
use embedded_io_async::{ErrorKind, ErrorType, Read, Write};
use mobgate_firmware::console::Terminal;
use static_cell::StaticCell;

/// Bytes of a packet: the most at full speed.
const PACKET_BYTES: u16 = 64;
/// Raspberry Pi's, for any serial port on an RP2040.
const VENDOR: u16 = 0x2e8a;
const PRODUCT: u16 = 0x000a;

type Usb = Driver<'static, USB>;

struct Buffers {
    configuration: [u8; 128],
    bos: [u8; 16],
    control: [u8; 64],
    packet: [u8; PACKET_BYTES as usize],
    state: State<'static>,
}

static BUFFERS: StaticCell<Buffers> = StaticCell::new();

/// The serial port as a host sees it.
pub(crate) struct Console {
    sender: Sender<'static, Usb>,
    receiver: BufferedReceiver<'static, Usb>,
}

/// The port, and the device, which [`run`] runs. `serial` tells boards apart.
pub(crate) fn new(
    driver: Usb,
    board: &'static str,
    serial: &'static str,
) -> (Console, UsbDevice<'static, Usb>) {
    let buffers = BUFFERS.init_with(|| Buffers {
        configuration: [0; 128],
        bos: [0; 16],
        control: [0; 64],
        packet: [0; PACKET_BYTES as usize],
        state: State::new(),
    });
    let mut config = Config::new(VENDOR, PRODUCT);
    (config.manufacturer, config.product, config.serial_number) =
        (Some("mobgate"), Some(board), Some(serial));
    let Buffers { configuration, bos, control, packet, state } = buffers;
    let mut builder = Builder::new(driver, config, configuration, bos, &mut [], control);
    let (sender, receiver) = CdcAcmClass::new(&mut builder, state, PACKET_BYTES).split();
    (Console { sender, receiver: receiver.into_buffered(packet) }, builder.build())
}

/// Runs the device.
#[embassy_executor::task]
pub(crate) async fn run(mut device: UsbDevice<'static, Usb>) -> ! {
    device.run().await
}

impl Terminal for Console {
    async fn opened(&mut self) {
        join(self.sender.wait_connection(), self.receiver.wait_connection()).await;
    }
}

impl ErrorType for Console {
    type Error = ErrorKind;
}

impl Read for Console {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, ErrorKind> {
        self.receiver.read(into).await.map_err(|_| ErrorKind::NotConnected)
    }
}

impl Write for Console {
    async fn write(&mut self, from: &[u8]) -> Result<usize, ErrorKind> {
        self.sender.write(from).await.map_err(|_| ErrorKind::NotConnected)
    }

    /// Waits until the host has what was written: an empty packet is taken over as soon as the one before is gone. A restart would
    /// lose it otherwise.
    async fn flush(&mut self) -> Result<(), ErrorKind> {
        self.sender.write_packet(&[]).await.map_err(|_| ErrorKind::NotConnected)
    }
}
