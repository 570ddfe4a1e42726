//! Commands on points: the values typed for a write, how a command is passed to the scanner, and when it is done. Publishers write
//! points the same way.

use embassy_time::Instant;
use heapless::Vec;

use crate::console::point_command::PointCommand;
use crate::language::{PointProblem, Problem, Words, Wrong, parse_number};
use crate::scanner::{DeviceId, Kind, Refused, RowId, Scanner, ScannerState, Status, ValueType, Writing};
use crate::settings::{PointAt, PointSettings, Settings};

/// Bytes of one point's values: one frame.
const POINT_BYTES_MAX: usize = 250;

/// Values of a point as in memory.
pub(super) type Cells = Vec<u8, POINT_BYTES_MAX>;

/// A parsed command.
pub(super) enum Ask {
    Row(RowId),
    /// The cells are stored separately: they are large.
    Put {
        row: RowId,
        first: u16,
        count: u16,
    },
    Range {
        device: DeviceId,
        function: u8,
        first: u16,
        last: u16,
    },
}

/// Whether the row's command is done; `false`: it cannot be sent for some time; `None`: not known yet.
pub(crate) fn settled(state: &ScannerState, row: RowId, give_up: Instant) -> Option<bool> {
    let waits = Status::IN_PROGRESS.with(Status::READ_MARKED).with(Status::WRITE_MARKED);
    let now = Instant::now();
    let status = state.with(|scanner| scanner.status(row, now));
    let idle = !status.any(waits) || status.any(Status::WRITE_BLOCKED);
    (idle || status.any(Status::BACKING_OFF) || now >= give_up).then_some(idle)
}

/// Parses the words after `command`.
pub(super) fn parse(
    settings: &Settings,
    command: PointCommand,
    words: &Words,
    cells: &mut Cells,
) -> Result<Ask, Wrong> {
    if command == PointCommand::Mark {
        return range(settings, words);
    }
    let word = words.take();
    let row = settings
        .find_point(word.text)
        .ok_or_else(|| word.error(Problem::Points(PointProblem::NoSuchPoint)))?;
    let point = settings
        .points
        .get(usize::from(row))
        .ok_or_else(|| word.error(Problem::Points(PointProblem::NoSuchPoint)))?;
    // A command on a point that shows another one applies to that one.
    let row = RowId(match point.at {
        PointAt::Local { of: Some(of), .. } => of,
        _ => row,
    });
    if command == PointCommand::Write && !words.peek().is_end() {
        return written(point, row, words, cells);
    }
    words.end()?;
    Ok(Ask::Row(row))
}

/// `meter 3 0-99`
fn range(settings: &Settings, words: &Words) -> Result<Ask, Wrong> {
    let word = words.take();
    let device = settings
        .find_device(word.text)
        .ok_or_else(|| word.error(Problem::Points(PointProblem::NoSuchDevice)))?;
    let word = words.take();
    let function = parse_number(word.text).and_then(|code| u8::try_from(code).ok());
    let function = function
        .filter(|code| Kind::of_function(*code).is_some())
        .ok_or_else(|| word.expected("a function: 1 to 4 to read, 5, 6, 15 or 16 to write"))?;
    let word = words.take();
    let (first, last) = word.text.split_once('-').unwrap_or((word.text, word.text));
    let address = |text| parse_number(text).and_then(|address| u16::try_from(address).ok());
    let (Some(first), Some(last)) = (address(first), address(last)) else {
        return Err(word.expected("addresses from 0 to 65535, such as 0-99"));
    };
    words.end()?;
    Ok(Ask::Range { device: DeviceId(device), function, first, last })
}

/// `17 18`, or `at 3 17 18`: values from the first one on, or from value 3 on.
fn written(point: &PointSettings, row: RowId, words: &Words, cells: &mut Cells) -> Result<Ask, Wrong> {
    let mut first = 0;
    if words.peek().is("at") {
        words.take();
        let word = words.take();
        let nth = parse_number(word.text).and_then(|nth| u16::try_from(nth).ok());
        first = nth.ok_or_else(|| word.expected("the number of a value, from 0"))?;
    }
    let mut count = 0;
    loop {
        let word = words.take();
        if word.is_end() && count > 0 {
            break;
        }
        if first + count >= point.count {
            return Err(word.expected("no more values than the point has"));
        }
        let kept = if point.value == ValueType::Bit {
            let bits = [("0", 0), ("1", 1), ("off", 0), ("on", 1)];
            let bit: u8 = word.keyword(&bits, "0 or 1")?;
            if count % 8 == 0 { cells.push(bit).is_ok() } else { set_last(cells, bit << (count % 8)) }
        } else {
            let value =
                point.value.parse(word.text).ok_or_else(|| word.expected("a value of the point's type"))?;
            cells
                .extend_from_slice(value.get(..2 * usize::from(point.value.registers())).unwrap_or(&[]))
                .is_ok()
        };
        if !kept {
            return Err(word.expected("no more values than the point has"));
        }
        count += 1;
    }
    let scale = point.value.registers();
    Ok(Ask::Put { row, first: first * scale, count: count * scale })
}

fn set_last(cells: &mut [u8], bits: u8) -> bool {
    cells.last_mut().map(|last| *last |= bits).is_some()
}

/// Passes the command to the scanner.
pub(super) fn order(
    scanner: &mut Scanner,
    command: PointCommand,
    ask: &Ask,
    cells: &[u8],
    now: Instant,
) -> Result<(), Refused> {
    match ask {
        Ask::Range { device, function, first, last } => {
            scanner.mark_range(*device, *function, *first, *last, now).map(|_| ())
        }
        Ask::Put { row, first, count } => {
            scanner.put(*row, *first, *count, cells, now)?;
            // A typed write is sent even if it changes nothing.
            let sent = scanner.row(*row).is_none_or(|row| row.device.is_none() || row.write == Writing::Auto);
            let blocked = scanner.status(*row, now).any(Status::WRITE_BLOCKED);
            if sent || blocked { Ok(()) } else { scanner.write(*row) }
        }
        Ask::Row(row) => match command {
            PointCommand::Read | PointCommand::Mark => scanner.read(*row, now),
            PointCommand::Write => scanner.write(*row),
            PointCommand::Begin => scanner.begin(*row, now),
            PointCommand::Finish => scanner.finish(*row),
        },
    }
}

/// Why a message does not write a point.
// Only publishers write by messages; also below.
#[cfg(feature = "mqtt")]
pub(crate) type Refusal = heapless::String<160>;

/// Writes the values in `text` to the point called `name`, as the command `write` does; returns its row. [`settled`] tells when it is
/// done.
#[cfg(feature = "mqtt")]
pub(crate) fn write_point(
    gateway: &crate::gateway::Gateway<'_>,
    name: &str,
    text: &str,
) -> Result<RowId, Refusal> {
    let said = |why: core::fmt::Arguments<'_>| {
        let mut refusal = Refusal::new();
        // What does not fit is cut.
        let _ = core::fmt::Write::write_fmt(&mut refusal, why);
        refusal
    };
    let state = gateway.scanner().ok_or_else(|| said(format_args!("there are no points")))?;
    let mut line = heapless::String::<{ POINT_BYTES_MAX }>::new();
    let is_whole = core::fmt::Write::write_fmt(&mut line, format_args!("{name} {text}")).is_ok();
    if !is_whole || text.trim_ascii().is_empty() {
        return Err(said(format_args!("expected values, at most {POINT_BYTES_MAX} bytes")));
    }
    let (words, mut cells) = (Words::new(&line), Cells::new());
    let parsed = gateway.settings(|settings| parse(settings, PointCommand::Write, &words, &mut cells));
    let Ok(ask @ Ask::Put { row, .. }) = parsed else {
        let wrong = words.wrong();
        return Err(said(format_args!("\"{}\": {}", wrong.word, wrong.problem)));
    };
    let done = state.change(|scanner| order(scanner, PointCommand::Write, &ask, &cells, Instant::now()));
    done.map(|()| row).map_err(|refused| said(format_args!("{refused}")))
}
