//! A W5500 on SPI0, which may be missing at first, or lose its power.

use core::cell::Cell;
use core::convert::Infallible;
use core::future::pending;
use core::task::Context;

use embassy_futures::join::join;
use embassy_futures::yield_now;
use embassy_net::driver::{Capabilities, Driver, HardwareAddress, LinkState};
use embassy_net_wiznet::chip::W5500;
use embassy_net_wiznet::{Device, State};
use embassy_rp::gpio::{Input, Output};
use embassy_rp::peripherals::SPI0;
use embassy_rp::spi::{Async, Spi};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embassy_sync::signal::Signal;
use embassy_sync::waitqueue::AtomicWaker;
use embassy_time::{Duration, Timer};
use embedded_hal::digital;
use embedded_hal_async::digital::Wait;
use embedded_hal_async::spi::{ErrorType, Operation, SpiDevice};
use embedded_hal_bus::spi::{ExclusiveDevice, NoDelay};
use static_cell::StaticCell;

/// Ethernet packets that wait each way.
const PACKETS: usize = 4;
/// Time between two looks at the chip.
const INTERVAL: Duration = Duration::from_millis(500);
/// Common registers, with the control byte to read them (W5500 data sheet, 2.2.2 and 4.1).
const ADDRESS: [u8; 3] = [0x00, 0x09, 0x00];
const VERSION: [u8; 3] = [0x00, 0x39, 0x00];
const VERSION_W5500: u8 = 4;

type Selected = ExclusiveDevice<Spi<'static, SPI0, Async>, Output<'static>, NoDelay>;

/// The chip, shared by its driver and the look whether it is still there.
#[derive(Clone, Copy)]
struct Shared<'c>(&'c Mutex<NoopRawMutex, Selected>);

impl ErrorType for Shared<'_> {
    type Error = <Selected as ErrorType>::Error;
}

impl SpiDevice for Shared<'_> {
    /// Yields, because the driver waits in a loop for room in the chip, and short transfers are over before the first look.
    async fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Self::Error> {
        yield_now().await;
        self.0.lock().await.transaction(operations).await
    }
}

/// The wires to the chip. A pull-down at MISO lets a missing chip read as zeros: no version, and no link.
pub(crate) struct Wires {
    pub(crate) device: Selected,
    /// Low while a packet has been received.
    pub(crate) interrupt: Input<'static>,
    /// Low resets the chip.
    pub(crate) reset: Output<'static>,
}

static QUEUES: StaticCell<State<PACKETS, PACKETS>> = StaticCell::new();
static CHIP: StaticCell<Chip> = StaticCell::new();

/// What the driver knows of the chip.
pub(crate) struct Chip {
    /// The driver's queues, once the chip has answered.
    device: Signal<NoopRawMutex, Device<'static>>,
    is_lost: Cell<bool>,
    waker: AtomicWaker,
}

impl Chip {
    fn set_lost(&self, is_lost: bool) {
        self.is_lost.set(is_lost);
        self.waker.wake();
    }
}

/// The embassy-net driver, at first without a chip.
pub(crate) struct LateEthernet {
    address: [u8; 6],
    chip: &'static Chip,
    device: Option<Device<'static>>,
}

impl LateEthernet {
    /// To be called once; [`run`] gets the chip.
    pub(crate) fn new(address: [u8; 6]) -> (Self, &'static Chip) {
        let chip = Chip { device: Signal::new(), is_lost: Cell::new(true), waker: AtomicWaker::new() };
        let chip: &Chip = CHIP.init(chip);
        (Self { address, chip, device: None }, chip)
    }
}

impl Driver for LateEthernet {
    type RxToken<'a> = <Device<'static> as Driver>::RxToken<'a>;
    type TxToken<'a> = <Device<'static> as Driver>::TxToken<'a>;

    fn receive(&mut self, context: &mut Context<'_>) -> Option<(Self::RxToken<'_>, Self::TxToken<'_>)> {
        self.device.as_mut()?.receive(context)
    }

    fn transmit(&mut self, context: &mut Context<'_>) -> Option<Self::TxToken<'_>> {
        self.device.as_mut()?.transmit(context)
    }

    fn link_state(&mut self, context: &mut Context<'_>) -> LinkState {
        self.chip.waker.register(context.waker());
        self.device = self.device.take().or_else(|| self.chip.device.try_take());
        match &mut self.device {
            Some(device) if !self.chip.is_lost.get() => device.link_state(context),
            _ => LinkState::Down,
        }
    }

    fn capabilities(&self) -> Capabilities {
        let mut capabilities = Capabilities::default();
        // The W5500's frames, without the check sum.
        capabilities.max_transmission_unit = 1514;
        capabilities.max_burst_size = Some(PACKETS);
        capabilities
    }

    fn hardware_address(&self) -> HardwareAddress {
        HardwareAddress::Ethernet(self.address)
    }
}

/// Looks for the chip, sets it up with `address`, and moves packets. A chip that has lost its registers is set up again.
pub(crate) async fn run(wires: Wires, address: [u8; 6], state: &Chip) -> ! {
    let Wires { mut device, interrupt, reset } = wires;
    wait_for(&mut device).await;
    let chip = Mutex::new(device);
    let queues = QUEUES.init(State::new());
    let started =
        embassy_net_wiznet::new::<_, _, W5500, _, _, _>(address, queues, Shared(&chip), interrupt, reset);
    // It has just answered. A chip that fails now gets no second chance before the next start: its queues are gone.
    let Ok((device, runner)) = started.await else { pending().await };
    state.device.signal(device);
    state.set_lost(false);
    mobgate_firmware::trial::found_network();
    let again = async {
        loop {
            Timer::after(INTERVAL).await;
            // Until it is released, the driver waits.
            let mut chip = chip.lock().await;
            // A chip without power has no address, nor has one after a reset.
            if read(&mut chip, &ADDRESS).await == address {
                continue;
            }
            state.set_lost(true);
            wait_for(&mut chip).await;
            let mut spare = State::<1, 1>::new();
            // The library's set-up; the packets go on through the first queues.
            let again = embassy_net_wiznet::new::<_, _, W5500, _, _, _>(
                address, &mut spare, &mut *chip, Never, Never,
            );
            state.set_lost(again.await.is_err());
        }
    };
    join(runner.run(), again).await.0
}

/// Reads a common register.
async fn read<const N: usize>(chip: &mut Selected, register: &[u8; 3]) -> [u8; N] {
    let mut value = [0; N];
    // SPI cannot fail here, and zeros are what a missing chip reads as.
    let _ = chip.transaction(&mut [Operation::Write(register), Operation::Read(&mut value)]).await;
    value
}

/// Waits until a W5500 responds.
async fn wait_for(chip: &mut Selected) {
    while read(chip, &VERSION).await != [VERSION_W5500] {
        Timer::after(INTERVAL).await;
    }
}

/// Pins that the second set-up leaves to the first driver.
struct Never;

impl digital::ErrorType for Never {
    type Error = Infallible;
}

impl digital::OutputPin for Never {
    fn set_low(&mut self) -> Result<(), Infallible> {
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

impl Wait for Never {
    async fn wait_for_high(&mut self) -> Result<(), Infallible> {
        pending().await
    }

    async fn wait_for_low(&mut self) -> Result<(), Infallible> {
        pending().await
    }

    async fn wait_for_rising_edge(&mut self) -> Result<(), Infallible> {
        pending().await
    }

    async fn wait_for_falling_edge(&mut self) -> Result<(), Infallible> {
        pending().await
    }

    async fn wait_for_any_edge(&mut self) -> Result<(), Infallible> {
        pending().await
    }
}
