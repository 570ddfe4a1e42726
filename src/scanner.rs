//! Data points: what the gateway polls from devices, and writes to them. Pure, with time as a value.
//!
//! A [`Row`] maps cells of a device to values in a bounded memory. Every 200 ms, or with a period of its own, a row that is due
//! is *marked for reading*; a change of its variable marks it for writing. [`Scanner::next`] makes a request of the marked rows:
//! writes first, then reads in the order in which they were marked, with neighbours gathered into one frame; each device has at
//! most one request in flight. [`Scanner::answered`] stores the result. A device that does not respond is asked twice more, then
//! left alone for 15 s, and tried again with single attempts after 15, 17, ... 29, 30 s.
//!
//! The same scanner serves tables of data points, whose variables are read and written in one place, and process images, with
//! separate inputs and outputs: there outputs are written when they differ from what was read back ([`Writing::OnChange`]). A row
//! without a device is visible to outside clients ([`Scanner::serve`]). Immediate reads and writes are requested at the console, or
//! by programs with commands of their own ([`Scanner::start`]).

mod bits;
mod byte_order;
mod commands;
// Only scales have decimal numbers.
#[cfg(feature = "long-values")]
mod decimal;
mod exchange;
mod fill;
mod form;
mod fraction;
mod gather;
mod kind;
// Replaced by stubs in images without longer types, scales and periodic writes.
#[cfg_attr(not(feature = "long-values"), path = "scanner/no_long.rs")]
mod long;
mod operation;
#[cfg_attr(not(feature = "long-values"), path = "scanner/no_period.rs")] // As `long`.
mod period;
mod program;
mod register_bits;
mod row;
#[cfg_attr(not(feature = "long-values"), path = "scanner/no_scale.rs")] // As `long`.
mod scale;
mod serve;
mod state;
mod station;
mod status;
// Only longer types have text.
#[cfg(feature = "long-values")]
mod text;
mod typed;
mod values;

use embassy_time::{Duration, Instant};
use heapless::Vec;

use self::gather::register;
use self::row::Entry;
use self::station::{Open, Station};
use self::values::Values;
use crate::modbus::Exception;
use crate::modbus::pdu::EXCEPTION_BIT;

pub(crate) use self::bits::copy_bits;
#[doc(hidden)] // Public for tests/ only.
pub use self::byte_order::ByteOrder;
#[doc(hidden)] // Public for tests/ only.
pub use self::commands::Refused;
#[cfg(feature = "long-values")] // As scales.
#[doc(hidden)] // Public for tests/ only.
pub use self::decimal::Decimal;
#[doc(hidden)] // Public for tests/ only.
pub use self::form::Form;
#[doc(hidden)] // Public for tests/ only.
pub use self::gather::Pdu;
#[doc(hidden)] // Public for tests/ only.
pub use self::kind::{Kind, Modicon};
#[doc(hidden)] // Public for tests/ only.
pub use self::long::{LONG_VALUES, LongForm, LongType, LongValue};
#[doc(hidden)] // Public for tests/ only.
pub use self::operation::Operation;
#[doc(hidden)] // Public for tests/ only.
pub use self::period::Period;
#[doc(hidden)] // Public for tests/ only.
pub use self::program::{ABANDONED_AFTER, REQUESTERS};
#[doc(hidden)] // Public for tests/ only.
pub use self::register_bits::{RegisterBit, RegisterBits};
#[doc(hidden)] // Public for tests/ only.
pub use self::row::{DeviceId, Reading, Row, RowId, SCAN, Writing};
#[cfg(feature = "long-values")] // Without, no value is out of such a range.
pub(crate) use self::scale::ValueRange;
#[doc(hidden)] // Public for tests/ only.
pub use self::scale::{Scale, Unfit};
pub(crate) use self::serve::age_register;
pub use self::state::ScannerState;
#[doc(hidden)] // Public for tests/ only.
pub use self::station::{BACK_OFF_FIRST, BACK_OFF_LONGEST, BACK_OFF_STEP, Device, DeviceStatus, REPEATS};
#[doc(hidden)] // Public for tests/ only.
pub use self::status::{ErrorCode, Status};
#[cfg(feature = "long-values")] // As text.
pub(crate) use self::text::TEXT_REGISTERS_MAX;
#[doc(hidden)] // Public for tests/ only.
pub use self::typed::{TypedValue, ValueType};
pub use self::values::VALUE_BYTES_MAX;

/// Whether the gateway can poll devices, for data points or as an EtherCAT SubDevice: the feature `points`. Without it, code that
/// depends on this constant is left out of the image.
pub const POINTS: bool = cfg!(feature = "points");

/// Devices of a scanner.
pub const DEVICES_MAX: usize = if POINTS { 32 } else { 0 };
/// Rows of a scanner: the four tables of every device, and some that need two frames.
pub const ROWS_MAX: usize = 136;

/// The scanner is full.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[doc(hidden)] // Public for tests/ only.
pub enum Full {
    /// [`DEVICES_MAX`] devices exist.
    #[error("there are {DEVICES_MAX} devices, the maximum")]
    Devices,
    /// [`ROWS_MAX`] rows exist.
    #[error("there are {ROWS_MAX} rows, the maximum")]
    Rows,
    /// The values take [`VALUE_BYTES_MAX`] bytes.
    #[error("the values take more than {VALUE_BYTES_MAX} bytes")]
    Values,
}

/// A request to send.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Request {
    /// The device, for [`Scanner::answered`].
    pub device: DeviceId,
    /// Its unit id.
    pub unit: u8,
    /// The request.
    pub pdu: Pdu,
}

/// The devices, their rows and values.
#[doc(hidden)] // Public for tests/ only.
pub struct Scanner {
    stations: Vec<Station, DEVICES_MAX>,
    entries: Vec<Entry, ROWS_MAX>,
    values: Values,
    /// When it was started: the origin of the scan raster.
    started: Instant,
    /// Counts marks.
    turn: u32,
    /// The device to look at first.
    first: usize,
    /// Whether outputs are written that differ from what was read back.
    outputs: bool,
}

impl Scanner {
    /// Without devices and rows.
    pub const fn new() -> Self {
        Self {
            stations: Vec::new(),
            entries: Vec::new(),
            values: Values::new(),
            started: Instant::MIN,
            turn: 0,
            first: 0,
            outputs: false,
        }
    }

    /// Removes everything; the scan raster begins at `now`.
    pub fn restart(&mut self, now: Instant) {
        self.forget_devices();
        self.values.clear();
        self.started = now;
        self.outputs = false;
    }

    /// Removes devices and rows; the values stay.
    pub fn forget_devices(&mut self) {
        self.stations.clear();
        self.entries.clear();
    }

    /// Allocates `bytes` of values, initially 0, and returns the index of the first.
    pub fn allocate(&mut self, bytes: u16) -> Result<u16, Full> {
        self.values.allocate(bytes).ok_or(Full::Values)
    }

    /// Adds a device.
    pub fn add_device(&mut self, device: Device) -> Result<DeviceId, Full> {
        let id = DeviceId(self.stations.len() as u8);
        self.stations.push(Station::new(device)).map_err(|_| Full::Devices)?;
        Ok(id)
    }

    /// Adds a row, whose memory has been allocated. It is due at once.
    pub fn add_row(&mut self, row: Row, now: Instant) -> Result<RowId, Full> {
        let id = RowId(self.entries.len() as u8);
        let since = now.saturating_duration_since(self.started);
        self.entries.push(Entry::new(row, since)).map_err(|_| Full::Rows)?;
        Ok(id)
    }

    /// Adds rows for the cells of `range`: as many as it takes frames, contiguous in memory. Nothing is added unless there is
    /// room for all.
    pub fn add_range(&mut self, range: Row, now: Instant) -> Result<(), Full> {
        // Whole values in each frame.
        let most = range.kind.cells_max(range.write != Writing::Never) & !range.form.rest();
        if self.entries.capacity() - self.entries.len() < usize::from(range.count.div_ceil(most)) {
            return Err(Full::Rows);
        }
        let mut done = 0;
        while done < range.count {
            let count = most.min(range.count - done);
            // Whole bytes of bits: the limits are multiples of 8.
            let bytes = range.kind.bytes(done);
            let first = range.first.saturating_add(done);
            let (input, output) = (range.input.saturating_add(bytes), range.output.saturating_add(bytes));
            self.add_row(Row { first, count, input, output, ..range }, now)?;
            done += count;
        }
        Ok(())
    }

    /// Number of devices.
    pub fn devices(&self) -> usize {
        self.stations.len()
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.entries.len()
    }

    /// The next request to send at `now`, if any.
    pub fn next(&mut self, now: Instant) -> Option<Request> {
        self.abandon(now);
        self.mark_again(now);
        self.mark_due(now);
        let count = self.stations.len();
        for nth in 0..count {
            let at = (self.first + nth) % count;
            if let Some(request) = self.ask(DeviceId(at as u8), now) {
                self.first = at + 1;
                return Some(request);
            }
        }
        None
    }

    /// Whether [`Scanner::next`] may have a request at `now`.
    pub fn is_due(&self, now: Instant) -> bool {
        let may = |station: &Station| station.pending && station.open.is_none() && !station.is_held(now);
        self.stations.iter().any(may) || self.due() <= now
    }

    /// When [`Scanner::next`] should be called again, if nothing happens until then.
    pub fn due(&self) -> Instant {
        let rows =
            self.entries.iter().filter_map(|entry| entry.due(self.held(entry)).map(|due| self.started + due));
        let held = self.entries.iter().filter_map(|entry| {
            let waits = entry.status.any(Status::WRITE_MARKED) && !entry.status.any(Status::WRITE_BLOCKED);
            let station = self.station(entry.row.device.filter(|_| waits)?)?;
            (station.open.is_none() && station.pending).then(|| station.held())
        });
        let abandoned = self.entries.iter().map(Entry::abandoned_at);
        let first = rows.chain(held).chain(abandoned).min().unwrap_or(Instant::MAX);
        if !LONG_VALUES {
            return first;
        }
        self.entries.iter().map(|entry| entry.again.due(entry.status)).fold(first, Instant::min)
    }

    /// Handles the outcome of the pending request to `device`: the response's PDU, or why there is none.
    pub fn answered(&mut self, device: DeviceId, now: Instant, response: Result<&[u8], ErrorCode>) {
        let Some(station) = self.stations.get_mut(usize::from(device.0)) else { return };
        let Some(open) = station.open.take() else { return };
        match response {
            Err(error) => {
                let again = station.failed(now, error);
                station.repeats = again.then_some(open);
                self.unanswered(device, error, again);
                if !again {
                    self.fill(device);
                }
            }
            Ok([function, exception, ..])
                if open == Open::Mask
                    && function & EXCEPTION_BIT != 0
                    && Exception(*exception) == Exception::ILLEGAL_FUNCTION =>
            {
                // Only a sign of life: from now on the bit is changed by read and write.
                station.answered(now, 0);
                station.refuses_masks = true;
                self.go_on(device, Open::Fetch);
            }
            Ok([function, exception, ..]) if function & EXCEPTION_BIT != 0 => {
                station.answered(now, *exception);
                match open {
                    Open::Check => {
                        station.status.alive = Some(false);
                        self.skip_poll(device);
                        self.fill(device);
                    }
                    _ => {
                        self.end(device, now, Err(ErrorCode::of_exception(*exception)), &[]);
                    }
                }
            }
            Ok(response) => {
                station.answered(now, 0);
                match open {
                    Open::Check => station.check_from = None,
                    Open::Fetch => match register(response.get(2..).unwrap_or_default(), 0) {
                        Some(register) => self.go_on(device, Open::Store { register }),
                        None => self.end(device, now, Err(ErrorCode::Unknown), &[]),
                    },
                    _ => self.end(device, now, Ok(open), response),
                }
            }
        }
    }

    /// Handles that the pending request to `device` was not sent: the gateway itself refused it with `exception`, because of a rule
    /// or a full queue. That says nothing about the device.
    pub fn refused(&mut self, device: DeviceId, now: Instant, exception: Exception) {
        let Some(station) = self.stations.get_mut(usize::from(device.0)) else { return };
        let Some(open) = station.open.take() else { return };
        let error = match ErrorCode::of_exception(exception.0) {
            ErrorCode::Unspecified => ErrorCode::Connection,
            forbidden => forbidden,
        };
        let crowded = error == ErrorCode::Connection;
        if open == Open::Mask && error == ErrorCode::Function {
            // A rule may forbid function 22 for devices that do not know it.
            station.refuses_masks = true;
            return self.go_on(device, Open::Fetch);
        }
        station.not_sent(error);
        if crowded {
            // A repeat at once would be refused again.
            station.hold(now + SCAN);
            self.unanswered(device, error, false);
        } else if open == Open::Check {
            self.skip_poll(device);
        } else {
            self.end(device, now, Err(error), &[]);
        }
    }

    /// Repeats pending requests, as their responses will not arrive.
    pub fn forget_open(&mut self) {
        for at in 0..self.stations.len() {
            let device = DeviceId(at as u8);
            let Some(station) = self.stations.get_mut(at) else { break };
            if let Some(open) = station.open.take() {
                // The register may have changed meanwhile.
                self.go_on(device, if let Open::Store { .. } = open { Open::Fetch } else { open });
            }
        }
    }

    fn station(&self, device: DeviceId) -> Option<&Station> {
        self.stations.get(usize::from(device.0))
    }

    /// How long the row's device backs off, counted from the scanner's start.
    fn held(&self, entry: &Entry) -> Duration {
        let station = entry.row.device.and_then(|device| self.station(device));
        station
            .map_or(Duration::from_ticks(0), |station| station.held().saturating_duration_since(self.started))
    }
}

const _: () = assert!(ROWS_MAX <= u8::MAX as usize, "a row's id is a byte");
const _: () = assert!(DEVICES_MAX <= u8::MAX as usize, "a device's id is a byte");
