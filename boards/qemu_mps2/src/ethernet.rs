//! The LAN9118 Ethernet controller for embassy-net: frames go through two FIFOs of 32-bit words.

use core::task::Context;

use embassy_net::driver::{Capabilities, Driver, HardwareAddress, LinkState, RxToken, TxToken};
use embassy_sync::waitqueue::AtomicWaker;

use crate::interrupts;
use crate::register::Register;

const BASE: usize = 0x4020_0000;
const RECEIVE_DATA: Register = Register::at(BASE, 0x00);
const TRANSMIT_DATA: Register = Register::at(BASE, 0x20);
const RECEIVE_STATUS: Register = Register::at(BASE, 0x40);
const TRANSMIT_STATUS: Register = Register::at(BASE, 0x48);
const INTERRUPT_CONFIG: Register = Register::at(BASE, 0x54);
const INTERRUPT_STATUS: Register = Register::at(BASE, 0x58);
const INTERRUPT_ENABLE: Register = Register::at(BASE, 0x5c);
const BYTE_TEST: Register = Register::at(BASE, 0x64);
const FIFO_LEVELS: Register = Register::at(BASE, 0x68);
const TRANSMIT_CONFIG: Register = Register::at(BASE, 0x70);
const HARDWARE_CONFIG: Register = Register::at(BASE, 0x74);
const RECEIVE_FILL: Register = Register::at(BASE, 0x7c);
const TRANSMIT_FILL: Register = Register::at(BASE, 0x80);
const MAC_COMMAND: Register = Register::at(BASE, 0xa4);
const MAC_DATA: Register = Register::at(BASE, 0xa8);
const FLOW_CONTROL: Register = Register::at(BASE, 0xac);

/// A frame was received.
const RECEIVED: u32 = 1 << 3;
/// PHY event: the link went up or down.
const PHY_NEWS: u32 = 1 << 18;
const MAC_BUSY: u32 = 1 << 31;
const MAC_READ: u32 = 1 << 30;

/// The MAC's registers, accessed through MAC_COMMAND.
#[derive(Clone, Copy)]
enum Mac {
    Control = 1,
    AddressHigh = 2,
    AddressLow = 3,
    PhyAccess = 6,
    PhyData = 7,
}

/// The PHY's registers, accessed through the MAC.
const PHY: u32 = 1;
const PHY_STATUS: u32 = 1;
const PHY_NEWS_SOURCE: u32 = 29;
const PHY_NEWS_MASK: u32 = 30;
const PHY_LINK: u32 = 1 << 2;
/// Link down, and negotiation complete.
const PHY_NEWS_WANTED: u32 = 1 << 4 | 1 << 6;

/// Longest frame, without its checksum.
const FRAME_BYTES_MAX: usize = 1514;
const CRC_BYTES: usize = 4;
/// The board's Ethernet address: locally administered.
const ADDRESS: [u8; 6] = [0x02, 0x6d, 0x6f, 0x62, 0x67, 0x01];

static NEWS: AtomicWaker = AtomicWaker::new();

/// Wakes the network task, which handles the event and enables interrupts again.
pub(crate) extern "C" fn on_interrupt() {
    INTERRUPT_ENABLE.write(0);
    NEWS.wake();
}

/// The controller.
pub(crate) struct Ethernet {
    link: LinkState,
    received: [u8; FRAME_BYTES_MAX + CRC_BYTES + 4],
    to_send: [u8; FRAME_BYTES_MAX],
}

impl Ethernet {
    /// Resets and starts the controller. It may have received a frame when this returns.
    pub(crate) fn start() -> Self {
        assert_eq!(BYTE_TEST.read(), 0x8765_4321, "no LAN9118 there, or with its bytes swapped");
        HARDWARE_CONFIG.write(1);
        while HARDWARE_CONFIG.read() & 1 != 0 {}
        // 5 KiB of FIFO for transmission, the rest for reception.
        HARDWARE_CONFIG.write(0x0015_0000);
        FLOW_CONTROL.write(0x006e_3740);
        INTERRUPT_CONFIG.write(0x2200_0111);
        FIFO_LEVELS.write(0x4800_0000);
        let [a, b, c, d, e, f] = ADDRESS;
        write_mac(Mac::AddressLow, u32::from_le_bytes([a, b, c, d]));
        write_mac(Mac::AddressHigh, u32::from_le_bytes([e, f, 0, 0]));
        write_phy(PHY_NEWS_MASK, PHY_NEWS_WANTED);
        // Full duplex, transmitter and receiver on.
        write_mac(Mac::Control, 0x0010_000c);
        TRANSMIT_CONFIG.write(2);
        interrupts::enable(interrupts::ETHERNET);
        Self { link: link(), received: [0; _], to_send: [0; _] }
    }

    /// Reads the next frame, if there is one; returns its length.
    fn receive_frame(&mut self) -> Option<usize> {
        while RECEIVE_FILL.read() >> 16 & 0xff != 0 {
            let status = RECEIVE_STATUS.read();
            let (length, broken) = ((status >> 16 & 0x3fff) as usize, status & 1 << 15 != 0);
            for word in 0..length.div_ceil(4) {
                let bytes = RECEIVE_DATA.read().to_le_bytes();
                // Frames that are too long must be drained, too.
                if let Some(place) = self.received.get_mut(4 * word..4 * word + 4) {
                    place.copy_from_slice(&bytes);
                }
            }
            if !broken && (CRC_BYTES..=FRAME_BYTES_MAX + CRC_BYTES).contains(&length) {
                return Some(length - CRC_BYTES);
            }
        }
        None
    }
}

impl Driver for Ethernet {
    type RxToken<'a> = Received<'a>;
    type TxToken<'a> = ToSend<'a>;

    fn receive(&mut self, context: &mut Context) -> Option<(Received<'_>, ToSend<'_>)> {
        NEWS.register(context.waker());
        INTERRUPT_STATUS.write(RECEIVED);
        // A frame that arrives after this check raises an interrupt.
        let length = self.receive_frame();
        let Some(length) = length else {
            INTERRUPT_ENABLE.write(RECEIVED | PHY_NEWS);
            return None;
        };
        Some((Received(&mut self.received[..length]), ToSend(&mut self.to_send)))
    }

    fn transmit(&mut self, _: &mut Context) -> Option<ToSend<'_>> {
        // Transmission is instantaneous in the emulator, so there is always room.
        Some(ToSend(&mut self.to_send))
    }

    fn link_state(&mut self, context: &mut Context) -> LinkState {
        NEWS.register(context.waker());
        if INTERRUPT_STATUS.read() & PHY_NEWS != 0 {
            // Reading the source clears the event.
            read_phy(PHY_NEWS_SOURCE);
            INTERRUPT_STATUS.write(PHY_NEWS);
            self.link = link();
            INTERRUPT_ENABLE.write(RECEIVED | PHY_NEWS);
        }
        self.link
    }

    fn capabilities(&self) -> Capabilities {
        let mut capabilities = Capabilities::default();
        capabilities.max_transmission_unit = FRAME_BYTES_MAX;
        capabilities.max_burst_size = Some(1);
        capabilities
    }

    fn hardware_address(&self) -> HardwareAddress {
        HardwareAddress::Ethernet(ADDRESS)
    }
}

/// A received frame.
pub(crate) struct Received<'a>(&'a mut [u8]);

impl RxToken for Received<'_> {
    fn consume<R, F: FnOnce(&mut [u8]) -> R>(self, f: F) -> R {
        f(self.0)
    }
}

/// Buffer for a frame to send.
pub(crate) struct ToSend<'a>(&'a mut [u8; FRAME_BYTES_MAX]);

impl TxToken for ToSend<'_> {
    fn consume<R, F: FnOnce(&mut [u8]) -> R>(self, length: usize, f: F) -> R {
        let frame = &mut self.0[..length];
        let result = f(frame);
        // A single segment: first and last.
        TRANSMIT_DATA.write(0x3000 | length as u32);
        TRANSMIT_DATA.write(length as u32);
        for bytes in frame.chunks(4) {
            let mut word = [0; 4];
            word[..bytes.len()].copy_from_slice(bytes);
            TRANSMIT_DATA.write(u32::from_le_bytes(word));
        }
        // Unread statuses would eventually stop the transmitter.
        while TRANSMIT_FILL.read() >> 16 & 0xff != 0 {
            TRANSMIT_STATUS.read();
        }
        result
    }
}

fn link() -> LinkState {
    if read_phy(PHY_STATUS) & PHY_LINK != 0 { LinkState::Up } else { LinkState::Down }
}

fn read_mac(register: Mac) -> u32 {
    MAC_COMMAND.write(MAC_BUSY | MAC_READ | register as u32);
    while MAC_COMMAND.read() & MAC_BUSY != 0 {}
    MAC_DATA.read()
}

fn write_mac(register: Mac, value: u32) {
    MAC_DATA.write(value);
    MAC_COMMAND.write(MAC_BUSY | register as u32);
    while MAC_COMMAND.read() & MAC_BUSY != 0 {}
}

fn read_phy(register: u32) -> u32 {
    write_mac(Mac::PhyAccess, PHY << 11 | register << 6 | 1);
    read_mac(Mac::PhyData)
}

fn write_phy(register: u32, value: u32) {
    write_mac(Mac::PhyData, value);
    write_mac(Mac::PhyAccess, PHY << 11 | register << 6 | 1 << 1 | 1);
}
