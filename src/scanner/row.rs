//! A row: cells of a device, the variable they are mapped to, and when they are read and written.

use embassy_time::{Duration, Instant};

use super::bits::bit;
use super::form::Form;
use super::kind::Kind;
use super::long::LONG_VALUES;
use super::operation::Command;
use super::period::{Again, Period};
use super::register_bits::RegisterBits;
use super::status::{ErrorCode, Status};
use super::values::Values;

/// The interval between scans for rows that are due.
pub const SCAN: Duration = Duration::from_millis(200);

/// A device's index in the scanner.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeviceId(pub u8);

/// A row's index in the scanner.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RowId(pub u8);

/// The parameters of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Row {
    /// The device to poll; `None` for a row visible to outside clients.
    pub device: Option<DeviceId>,
    /// The table of the device.
    pub kind: Kind,
    /// The first address, as on the wire.
    pub first: u16,
    /// Number of cells.
    pub count: u16,
    /// Index of the input values in memory.
    pub input: u16,
    /// Index of the output values in memory; equal to `input` for a single variable.
    pub output: u16,
    /// When it is read.
    pub read: Reading,
    /// When it is written.
    pub write: Writing,
    /// Uses function 15 or 16 even for one cell.
    pub multiple: bool,
    /// The mapping of the cells to the variable.
    pub form: Form,
    /// The row whose variable this one shows, if it has none of its own.
    pub of: Option<RowId>,
    /// Input registers with the row's status word and age, for clients.
    pub quality: Option<u16>,
}

impl Row {
    /// The address after the last cell.
    pub(super) fn end(&self) -> u32 {
        u32::from(self.first) + u32::from(self.count)
    }

    /// The table and number of cells of its variable.
    pub(super) fn variable(&self) -> (Kind, u16) {
        self.form.variable(self.kind, self.count)
    }

    /// Bytes of its variable.
    pub(super) fn bytes(&self) -> u16 {
        let (kind, cells) = self.variable();
        kind.bytes(cells)
    }

    /// Whether inputs and outputs differ, ignoring unused bits.
    pub(super) fn differs(&self, values: &Values) -> bool {
        let (kind, cells) = self.variable();
        let bytes = kind.bytes(cells);
        let (input, output) = (values.span(self.input, bytes), values.span(self.output, bytes));
        if kind.is_bits() {
            return (0..usize::from(cells)).any(|at| bit(input, at) != bit(output, at));
        }
        input != output
    }

    /// The bits of a register, for rows that are no more than that; always written alone.
    pub(super) fn register_bits(&self) -> Option<RegisterBits> {
        if let Form::Bits(bits) = self.form { Some(bits) } else { None }
    }

    /// Whether inputs and outputs are a single variable. Of a row that is written periodically the inputs are; its outputs are what
    /// was written last.
    pub(super) fn is_one_variable(&self) -> bool {
        self.input == self.output || self.write.period().is_some()
    }
}

/// When a row is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reading {
    /// At every 25th scan: every 5 s.
    Low,
    /// At every 5th scan: every second.
    Normal,
    /// At every scan: every 200 ms.
    High,
    /// With its own period, in milliseconds.
    Every(u32),
    /// Only on request.
    Manual,
}

impl Reading {
    /// The time between readings.
    pub const fn period(self) -> Option<Duration> {
        Some(match self {
            Self::Low => Duration::from_millis(5_000),
            Self::Normal => Duration::from_millis(1_000),
            Self::High => SCAN,
            Self::Every(ms) => Duration::from_millis(ms as u64),
            Self::Manual => return None,
        })
    }

    /// The raster to which readings are aligned.
    const fn raster(self) -> Duration {
        match self {
            Self::Every(ms) => Duration::from_millis(ms as u64),
            Self::Low | Self::Normal | Self::High | Self::Manual => SCAN,
        }
    }
}

/// When a row is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Writing {
    /// Never.
    Never,
    /// Whenever the variable is written, even with the same value.
    Auto,
    /// Only on request.
    Manual,
    /// When a value is written that differs from the one written or read last, or that could not be written; an output also when
    /// the value read differs.
    OnChange,
    /// Whenever the variable is written, and its last value again and again.
    Every(Period),
}

impl Writing {
    /// Whether it is written whenever the variable is.
    pub const fn is_auto(self) -> bool {
        matches!(self, Self::Auto | Self::Every(_))
    }

    /// How often the value written last is written again.
    pub const fn period(self) -> Option<Period> {
        if let Self::Every(period) = self { Some(period) } else { None }
    }
}

/// A row with its state.
pub(super) struct Entry {
    pub(super) row: Row,
    pub(super) status: Status,
    /// The turns in which it was marked for reading and for writing: the lowest goes first.
    pub(super) read_turn: u32,
    pub(super) write_turn: u32,
    /// It was in the frame that got no response and is repeated.
    pub(super) repeats: bool,
    /// When it is read next, counted from the scanner's start.
    next: Duration,
    /// When its values were last read, or set by a client of this gateway or in a safe write.
    pub(super) fresh: Instant,
    /// When it is written again.
    pub(super) again: Again,
    /// The last command of a program.
    pub(super) command: Command,
}

impl Entry {
    /// Due as soon as its raster allows; `now` is counted from the scanner's start.
    pub(super) fn new(row: Row, now: Duration) -> Self {
        let next = round_up(now, row.read.raster());
        let fresh = Instant::MIN;
        let (again, command) = (Again::NEVER, Command::NONE);
        Self {
            row,
            status: Status::NEW,
            read_turn: 0,
            write_turn: 0,
            repeats: false,
            next,
            fresh,
            again,
            command,
        }
    }

    /// Records the start of its request.
    pub(super) fn begin(&mut self, write: bool) {
        self.status.begin(write);
        self.command.sent(write);
    }

    /// Records the end of its request.
    pub(super) fn end(&mut self, write: bool, outcome: Result<(), ErrorCode>) {
        self.status.end(write, outcome);
        self.command.ended(write, outcome);
    }

    /// Drops its pending read.
    pub(super) fn drop_read(&mut self) {
        self.status.clear(Status::READ_MARKED);
        self.command.read_dropped();
    }

    /// When it is due, counted from the scanner's start, if its device backs off until `held`.
    pub(super) fn due(&self, held: Duration) -> Option<Duration> {
        self.row.read.period()?;
        if self.row.device.is_none() || self.status.any(Status::READ_MARKED) {
            return None;
        }
        Some(self.next.max(round_up(held, self.row.read.raster())))
    }

    /// Marks it at `now`, as it was due at `due`.
    pub(super) fn mark_due(&mut self, due: Duration, now: Duration, turn: u32) {
        self.status.set(Status::READ_MARKED);
        self.read_turn = turn;
        let next = due + self.row.read.period().unwrap_or(SCAN);
        self.next = if next > now {
            next
        } else {
            // Periods that were missed are skipped.
            round_up(now + Duration::from_ticks(1), self.row.read.raster())
        };
    }
}

/// The first multiple of `raster` not before `time`.
fn round_up(time: Duration, raster: Duration) -> Duration {
    let raster = raster.as_ticks().max(1);
    Duration::from_ticks(time.as_ticks().div_ceil(raster) * raster)
}

const _: () = assert!(size_of::<Entry>() <= if LONG_VALUES { 72 } else { 56 }, "there are many rows");
