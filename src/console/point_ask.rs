//! The words of commands on data points: a point and its values, or a range of a device's cells.

use heapless::Vec;

use super::point_command::PointCommand;
use crate::language::{PointProblem, Problem, Words, Wrong, parse_number};
use crate::scanner::{DeviceId, Kind, LONG_VALUES, RowId, Unfit, ValueType};
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
        // An empty text is a word.
        let is_end = words.peek().is_end();
        let word = if LONG_VALUES { words.take_quoted() } else { words.take() };
        if is_end && count > 0 {
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
            let value = point.scale.parse(point.value, point.value_bits(), word.text);
            let value = value.map_err(|unfit| match unfit {
                Unfit::NoValue if point.value.is_text() && !is_end => {
                    word.expected("a text that fits, in which \\x41 stands for a byte")
                }
                Unfit::NoValue => word.expected("a value of the point's type"),
                // As scales.
                #[cfg(feature = "long-values")]
                Unfit::Beyond(range) => word.error(Problem::Points(PointProblem::Beyond(range))),
            })?;
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
