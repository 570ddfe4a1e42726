//! Modbus TCP through EtherCAT's mailboxes, beside process data in cycles of 1 ms.

// The world of the tests, which need more of it.
#[allow(dead_code)]
#[path = "../../../boards/net/tests/net/cable.rs"]
mod cable;
#[path = "../../../boards/net/tests/net/through_ethercat.rs"]
mod through_ethercat;

use crate::prelude::*;
use through_ethercat::transactions;

const TRANSACTIONS: u16 = 10_000;

pub(crate) fn figures() {
    let fared = transactions(TRANSACTIONS);
    figure("eoe_transactions_a_second", fared.a_second, "1/s", Target::AtLeast(200.0));
    figure("eoe_transactions_wrong", fared.wrong as f64, "of 10000", Target::AtMost(0.0));
    figure("eoe_cycles", fared.seen.cycles.get() as f64, "cycles", Target::None);
    figure("eoe_cycles_lost", fared.seen.lost.get() as f64, "cycles", Target::AtMost(0.0));
    figure("eoe_cycles_late", fared.seen.late.get() as f64, "cycles", Target::AtMost(0.0));
}
