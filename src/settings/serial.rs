//! Settings of serial lines: speed, format, gaps, driver control, and those of each side.

use embassy_time::{Duration, TICK_HZ};
use heapless::String;

use crate::settings::{DEVICE_BYTES_MAX, PROOFS_MAX, Proof, Proofs, Side};

/// The framing of a serial line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Framing {
    /// Binary frames ended by silence.
    Rtu,
    /// Hexadecimal frames between `:` and CR LF.
    Ascii,
}

/// A serial port.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SerialSettings {
    /// The board's name of the line: `uart1`, `/dev/ttyUSB0`.
    pub device: String<DEVICE_BYTES_MAX>,
    /// RTU or ASCII.
    pub framing: Framing,
    /// Client or server.
    pub side: Side,
    /// Speed, format and gaps.
    pub line: LineSettings,
    /// For [`Side::Client`].
    pub client: SerialClientSettings,
    /// For [`Side::Server`].
    pub server: SerialServerSettings,
}

impl SerialSettings {
    /// An RTU client on `device` with the defaults.
    pub(crate) const fn new(device: String<DEVICE_BYTES_MAX>) -> Self {
        Self {
            device,
            framing: Framing::Rtu,
            side: Side::Client,
            line: LineSettings::DEFAULT,
            client: SerialClientSettings::DEFAULT,
            server: SerialServerSettings::DEFAULT,
        }
    }

    /// The same device, framing and side with default settings.
    pub(super) fn plain(&self) -> Self {
        Self { framing: self.framing, side: self.side, ..Self::new(self.device.clone()) }
    }
}

/// Speed, character format and silent intervals of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LineSettings {
    /// Bits per second, 1 to 10 000 000.
    pub baud: u32,
    /// 7 or 8.
    pub data_bits: u8,
    /// Parity bit.
    pub parity: Parity,
    /// 1 or 2.
    pub stop_bits: u8,
    /// Silence between frames; `None` is the specification's t3.5.
    pub gap: Option<Duration>,
    /// Longest silence inside a frame; `None` is the general rule (a frame ends after the gap).
    pub char_timeout: Option<Duration>,
    /// How the transceiver's driver is controlled.
    pub driver: Driver,
    /// Time from enabling the driver to the first start bit.
    pub driver_before: Duration,
    /// Time from the last stop bit to disabling the driver.
    pub driver_after: Duration,
    /// The adapter receives its own transmission, which is compared and dropped.
    pub echo: bool,
}

/// Control of the driver on a two-wire line, for switching between receiving and sending.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Driver {
    /// None needed: RS-232, four wires, or an adapter with automatic control.
    Automatic,
    /// By the hardware or its driver (Linux: TIOCSRS485); refused if unsupported.
    Rs485,
    /// By the gateway, with RTS.
    Rts,
}

/// Parity of a character.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Parity {
    /// No parity bit.
    None,
    /// Even number of ones.
    Even,
    /// Odd number of ones.
    Odd,
}

impl LineSettings {
    /// Modbus over Serial Line 2.5.1: 19200 baud, even parity.
    pub const DEFAULT: Self = Self {
        baud: 19_200,
        data_bits: 8,
        parity: Parity::Even,
        stop_bits: 1,
        gap: None,
        char_timeout: None,
        driver: Driver::Automatic,
        driver_before: Duration::from_ticks(0),
        driver_after: Duration::from_ticks(0),
        echo: false,
    };

    /// Bits of one character: start, data, parity, stop.
    pub(crate) const fn bits_per_char(&self) -> u32 {
        1 + self.data_bits as u32 + !matches!(self.parity, Parity::None) as u32 + self.stop_bits as u32
    }

    /// Duration of `chars` characters, rounded up to the clock's tick.
    pub fn chars(&self, chars: usize) -> Duration {
        self.bits(chars as u64 * u64::from(self.bits_per_char()), self.baud)
    }

    /// Duration of `bits` at `baud`, rounded up to the clock's tick.
    fn bits(&self, bits: u64, baud: u32) -> Duration {
        let parts = bits * TICK_HZ;
        Duration::from_ticks(match u32::try_from(parts) {
            // Enough for a frame, and a single instruction on a small processor.
            Ok(parts) => parts.div_ceil(baud).into(),
            Err(_) => parts.div_ceil(baud.into()),
        })
    }

    /// The specification's t3.5: 3.5 characters, fixed at 1.750 ms above 19200 baud (Serial Line 2.5.1.1).
    pub fn t3_5(&self) -> Duration {
        if self.baud > 19_200 {
            return Duration::from_micros(1_750);
        }
        self.half_chars(7)
    }

    /// The specification's t1.5, the longest silence inside an RTU frame: 1.5 characters, fixed at 750 us above 19200 baud.
    pub fn t1_5(&self) -> Duration {
        if self.baud > 19_200 { Duration::from_micros(750) } else { self.half_chars(3) }
    }

    fn half_chars(&self, count: u64) -> Duration {
        self.bits(count * u64::from(self.bits_per_char()), 2 * self.baud)
    }

    /// The silence that ends a frame and must precede one.
    pub fn gap(&self) -> Duration {
        self.gap.unwrap_or_else(|| self.t3_5())
    }
}

/// Settings of a client-side serial port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SerialClientSettings {
    /// Response time-out, from the last bit of the request to the first character of the response.
    pub timeout: Duration,
    /// Repeats of a read that got no response or a corrupt one. Writes are never repeated.
    pub retries: u8,
    /// Pause after a broadcast.
    pub turnaround: Duration,
    /// Silence after the port is opened, for devices that are still starting.
    pub start_delay: Duration,
    /// How long received bytes are discarded after the line was opened, and how long a unit gets no request whose response could be
    /// confused, if no proof is possible; `None`: `timeout`.
    pub late_window: Option<Duration>,
    /// Time-outs in a row after which a unit is down and requests to it fail at once; 0: never.
    pub down_after: u8,
    /// How units are proved to be in step.
    pub proofs: Proofs,
}

impl SerialClientSettings {
    /// How long an unsolicited response may still arrive.
    pub fn late_window(&self) -> Duration {
        self.late_window.unwrap_or(self.timeout)
    }

    /// 800 ms, no repeats, 100 ms after a broadcast, down after three time-outs.
    pub const DEFAULT: Self = Self {
        timeout: Duration::from_millis(800),
        retries: 0,
        turnaround: Duration::from_millis(100),
        start_delay: Duration::from_ticks(0),
        late_window: None,
        down_after: 3,
        proofs: Proofs { all: Proof::Auto, of_units: [None; PROOFS_MAX] },
    };
}

/// Settings of a server-side serial port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SerialServerSettings {
    /// Time from the request to the response. After that the master has given up: no response is sent, and a request not sent yet
    /// is dropped.
    pub answer_within: Duration,
    /// Minimum time from the end of the request to the response, for masters that are slow to switch to receiving; never below
    /// the gap.
    pub reply_delay: Duration,
}

impl SerialServerSettings {
    /// A response within 3 s, without delay.
    pub const DEFAULT: Self =
        Self { answer_within: Duration::from_secs(3), reply_delay: Duration::from_ticks(0) };
}
