//! How a command on a point is passed to the scanner, and when it is done. Publishers write points the same way.

use embassy_time::Instant;

use super::point_ask::Ask;
use super::point_command::PointCommand;
use crate::scanner::{Refused, RowId, Scanner, ScannerState, Status};

/// Whether the row's command is done; `false`: it cannot be sent for some time; `None`: not known yet.
pub(crate) fn settled(state: &ScannerState, row: RowId, give_up: Instant) -> Option<bool> {
    let waits = Status::IN_PROGRESS.with(Status::READ_MARKED).with(Status::WRITE_MARKED);
    let now = Instant::now();
    let status = state.with(|scanner| scanner.status(row, now));
    let idle = !status.any(waits) || status.any(Status::WRITE_BLOCKED);
    (idle || status.any(Status::BACKING_OFF) || now >= give_up).then_some(idle)
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
            let sent = scanner.row(*row).is_none_or(|row| row.device.is_none() || row.write.is_auto());
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
