//! Registers of the own unit that operate data points from a program: immediate reads and writes, accepted commands, and the status
//! of each point. The table is in docs/registers.md.

use embassy_time::Instant;

use crate::gateway::Gateway;
use crate::modbus::Exception;
use crate::modbus::pdu::function::{WRITE_MULTIPLE_REGISTERS, WRITE_SINGLE_REGISTER};
use crate::scanner::{REQUESTERS, ROWS_MAX, Refused, RowId};

/// The registers of point 0: the holding register takes commands, the input register is the status word.
pub const POINTS: u16 = 0xf000;
/// The first of four holding registers, written together, that operate all points of a device within a range of cells.
pub const RANGE: u16 = 0xf100;
/// The holding register with the progress of the commands of requester 0.
pub const COMMANDS: u16 = 0xf110;
const POINTS_END: u16 = POINTS + ROWS_MAX as u16;
const COMMANDS_END: u16 = COMMANDS + REQUESTERS as u16;

const _: () = assert!(POINTS_END <= RANGE);

/// The holding register at `address`, if there is one.
pub(super) fn holding(gateway: &Gateway<'_>, address: u16) -> Option<u16> {
    gateway.scanner()?.with(|scanner| match address {
        POINTS..POINTS_END => scanner.command(RowId((address - POINTS) as u8)),
        COMMANDS..COMMANDS_END => Some(scanner.commands_of((address - COMMANDS) as u8)),
        _ => None,
    })
}

/// The input register at `address`, if there is one.
pub(super) fn input(gateway: &Gateway<'_>, address: u16) -> Option<u16> {
    let id = RowId(u8::try_from(address.checked_sub(POINTS)?).ok()?);
    gateway.scanner()?.with(|scanner| {
        scanner.row(id)?;
        Some(scanner.status(id, Instant::now()).bits())
    })
}

/// Executes `request`, if it writes to these registers.
pub(super) fn write(gateway: &Gateway<'_>, request: &[u8]) -> Option<Result<(), Exception>> {
    let (first, values) = match *request {
        [WRITE_SINGLE_REGISTER, a, b, ref values @ ..] => ([a, b], values),
        // Quantity and byte count are in between.
        [WRITE_MULTIPLE_REGISTERS, a, b, _, _, _, ref values @ ..] => ([a, b], values),
        _ => return None,
    };
    let first = u16::from_be_bytes(first);
    let port_state = gateway.scanner().filter(|_| first >= POINTS)?;
    let now = Instant::now();
    let done = port_state.change(|scanner| match (first, values) {
        (POINTS..POINTS_END, &[a, b]) => {
            scanner.start(RowId((first - POINTS) as u8), u16::from_be_bytes([a, b]), now)
        }
        (RANGE, &[a, b, c, d, e, f, g, h]) => {
            scanner.start_range([[a, b], [c, d], [e, f], [g, h]].map(u16::from_be_bytes), now)
        }
        _ => Err(Refused::NotThere),
    });
    Some(done.map_err(|refused| match refused {
        Refused::NotThere | Refused::NoDevice => Exception::ILLEGAL_ADDRESS,
        Refused::Value | Refused::ReadOnly | Refused::NotBlocked => Exception::ILLEGAL_VALUE,
        Refused::Taken | Refused::Blocked | Refused::BackingOff(_) => Exception::BUSY,
    }))
}
