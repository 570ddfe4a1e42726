//! The chip's Ethernet with the boards' RMII PHY. A PHY that is missing, or gives no clock, is retried twice a second:
//! embassy-stm32's driver would wait for it and block everything else. Speed and duplex are negotiated.

use core::task::Context;

use embassy_net::driver::{Capabilities, Driver, HardwareAddress, LinkState};
use embassy_stm32::eth::{self, Ethernet, PacketQueue, Phy, Sma, StationManagement};
use embassy_stm32::gpio::{Input, Pull};
use embassy_stm32::uid::uid;
use embassy_stm32::{Peri, peripherals as p};
use embassy_time::{Duration, Instant};
use static_cell::ConstStaticCell;

use crate::interrupts::Interrupts;
use crate::registers;

/// Received packets that the DMA holds until they are read: a request of each client, all in one instant. A faster chip reads
/// most of them meanwhile.
const PACKETS: usize = if cfg!(feature = "h7") {
    4
} else if cfg!(feature = "f7") {
    12
} else {
    8
};
/// Outgoing packets leave within microseconds.
const PACKETS_OUT: usize = 2;

static QUEUE: ConstStaticCell<PacketQueue<PACKETS_OUT, PACKETS>> = ConstStaticCell::new(PacketQueue::new());

/// Poll interval for the link, or for a missing PHY.
const INTERVAL: Duration = Duration::from_millis(500);
/// A PHY reset takes at most half a second (IEEE 802.3, 22.2.4.1.1).
const RESET_MAX: Duration = Duration::from_millis(500);
/// Longest frame, without its checksum.
const FRAME_BYTES: usize = 1514;
/// Samples of the 50 MHz clock before it counts as missing.
const LOOKS: usize = 1_000;

// Registers of every PHY (IEEE 802.3, 22.2.4) and their bits.
const CONTROL: u8 = 0;
const CONTROL_RESET: u16 = 1 << 15;
const CONTROL_NEGOTIATE: u16 = 1 << 12 | 1 << 9;
const STATUS: u8 = 1;
const STATUS_UP: u16 = 1 << 5 | 1 << 2;
const IDENTIFIER: u8 = 2;
const OWN_ABILITIES: u8 = 4;
const PARTNERS_ABILITIES: u8 = 5;
const FULL_100: u16 = 1 << 8;
const HALF_100: u16 = 1 << 7;
const FULL_10: u16 = 1 << 6;

/// The Ethernet's peripherals, held until a PHY is found.
pub(crate) struct Parts {
    pub(crate) eth: Peri<'static, p::ETH>,
    pub(crate) clock: Peri<'static, p::PA1>,
    pub(crate) carrier: Peri<'static, p::PA7>,
    pub(crate) receive: (Peri<'static, p::PC4>, Peri<'static, p::PC5>),
    pub(crate) transmit: (Peri<'static, p::PG13>, Peri<'static, p::PB13>, Peri<'static, p::PG11>),
    pub(crate) management: (Peri<'static, p::ETH_SMA>, Peri<'static, p::PA2>, Peri<'static, p::PC1>),
}

/// The Ethernet, with its PHY or waiting for one.
pub(crate) struct LateEthernet {
    address: [u8; 6],
    parts: Option<(Parts, &'static mut PacketQueue<PACKETS_OUT, PACKETS>)>,
    driver: Option<Ethernet<'static, p::ETH, NegotiatingPhy>>,
    next_look: Instant,
}

impl LateEthernet {
    /// Derives the address from the chip's unique number. To be called once.
    pub(crate) fn new(parts: Parts) -> Self {
        let address = mobgate_board::ethernet_address(&uid());
        Self { address, parts: Some((parts, QUEUE.take())), driver: None, next_look: Instant::MIN }
    }

    /// Starts the driver if the PHY is present.
    fn look(&mut self) {
        let Some((mut parts, queue)) = self.parts.take() else { return };
        let number = has_clock(&mut parts).then(|| find(&mut parts)).flatten();
        let Some(number) = number else {
            self.parts = Some((parts, queue));
            return;
        };
        let Parts { eth, clock, carrier, receive, transmit, management } = parts;
        let management = Sma::new(management.0, management.1, management.2);
        let phy = NegotiatingPhy { management, number, is_up: false, next_look: Instant::MIN };
        mobgate_firmware::trial::found_network();
        self.driver = Some(Ethernet::new_with_phy(
            queue,
            eth,
            Interrupts,
            clock,
            carrier,
            receive.0,
            receive.1,
            transmit.0,
            transmit.1,
            transmit.2,
            self.address,
            phy,
        ));
    }
}

/// Whether the PHY supplies its 50 MHz clock, without which a reset of the MAC never completes.
fn has_clock(parts: &mut Parts) -> bool {
    let pin = Input::new(parts.clock.reborrow(), Pull::None);
    let first = pin.is_high();
    (0..LOOKS).any(|_| pin.is_high() != first)
}

/// The address of the PHY that responds.
fn find(parts: &mut Parts) -> Option<u8> {
    let (management, data, clock) = &mut parts.management;
    let mut management = Sma::new(management.reborrow(), data.reborrow(), clock.reborrow());
    (0..32).find(|&number| !matches!(management.smi_read(number, IDENTIFIER), 0 | u16::MAX))
}

impl Driver for LateEthernet {
    type RxToken<'a> = eth::RxToken<'a, 'static>;
    type TxToken<'a> = eth::TxToken<'a, 'static>;

    fn receive(&mut self, context: &mut Context<'_>) -> Option<(Self::RxToken<'_>, Self::TxToken<'_>)> {
        // As in the driver: nothing is received without room for the response.
        self.transmit(context)?;
        self.driver.as_mut()?.receive(context)
    }

    fn transmit(&mut self, context: &mut Context<'_>) -> Option<Self::TxToken<'_>> {
        let packet = self.driver.as_mut()?.transmit(context);
        // A sent packet wakes the stack only if it waits for one.
        registers::interrupt_when_sent(packet.is_none());
        packet
    }

    fn link_state(&mut self, context: &mut Context<'_>) -> LinkState {
        if self.driver.is_none() && is_time(&mut self.next_look, context) {
            self.look();
        }
        self.driver.as_mut().map_or(LinkState::Down, |driver| driver.link_state(context))
    }

    fn capabilities(&self) -> Capabilities {
        let mut capabilities = Capabilities::default();
        capabilities.max_transmission_unit = FRAME_BYTES;
        capabilities.max_burst_size = Some(PACKETS_OUT);
        capabilities
    }

    fn hardware_address(&self) -> HardwareAddress {
        HardwareAddress::Ethernet(self.address)
    }
}

/// Whether time `at` has come, which then moves on by an interval; wakes the task at that time.
fn is_time(at: &mut Instant, context: &mut Context<'_>) -> bool {
    let now = Instant::now();
    let is_time = now >= *at;
    if is_time {
        *at = now + INTERVAL;
    }
    embassy_time_driver::schedule_wake(at.as_ticks(), context.waker());
    is_time
}

/// A PHY that negotiates speed and duplex.
pub(crate) struct NegotiatingPhy {
    management: Sma<'static, p::ETH_SMA>,
    number: u8,
    is_up: bool,
    next_look: Instant,
}

impl NegotiatingPhy {
    fn read(&mut self, register: u8) -> u16 {
        self.management.smi_read(self.number, register)
    }
}

impl Phy for NegotiatingPhy {
    fn phy_reset(&mut self) {
        self.management.smi_write(self.number, CONTROL, CONTROL_RESET);
        let end = Instant::now() + RESET_MAX;
        while self.read(CONTROL) & CONTROL_RESET != 0 && Instant::now() < end {}
    }

    fn phy_init(&mut self) {
        self.management.smi_write(self.number, CONTROL, CONTROL_NEGOTIATE);
    }

    fn poll_link(&mut self, context: &mut Context<'_>) -> bool {
        if !is_time(&mut self.next_look, context) {
            return self.is_up;
        }
        let was_up = self.is_up;
        self.is_up = self.read(STATUS) & STATUS_UP == STATUS_UP;
        if self.is_up && !was_up {
            // The best common mode. A partner that does not negotiate is detected by its speed, at half duplex.
            let common = self.read(OWN_ABILITIES) & self.read(PARTNERS_ABILITIES);
            let is_100 = common & (FULL_100 | HALF_100) != 0;
            let is_full = common & FULL_100 != 0 || common & (HALF_100 | FULL_10) == FULL_10;
            registers::set_ethernet_speed(is_100, is_full);
        }
        self.is_up
    }
}
