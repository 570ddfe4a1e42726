//! The EtherCAT process image as input registers of the gateway's own unit, for those who are no MainDevice: what was read from
//! the slaves and what is to be written to them, from memory, with the state and the age of each. docs/registers.md has the table.

use embassy_time::Instant;

use crate::fieldbus::EthercatState;
use crate::scanner::{DEVICES_MAX, age_register};

/// The first register of the inputs; each has two bytes, the first one high.
pub const INPUTS: u16 = 0xe000;
/// The first register of the outputs.
pub const OUTPUTS: u16 = 0xe200;
/// The first register of slave 0, of two for each: its state as in 2032h, and how old its last response is.
pub const SLAVES: u16 = 0xe400;
/// Of images longer than 1024 bytes the rest has no place here.
const INPUTS_END: u16 = OUTPUTS;
const OUTPUTS_END: u16 = SLAVES;
const SLAVES_END: u16 = 0xe440;

const _: () = assert!(SLAVES + 2 * DEVICES_MAX as u16 <= SLAVES_END);

/// What stands at `address`; none if nothing does.
pub(super) fn register(ethercat: &EthercatState, address: u16) -> Option<u16> {
    match address {
        INPUTS..INPUTS_END => ethercat.inputs(|bytes| word(bytes, address - INPUTS)),
        OUTPUTS..OUTPUTS_END => ethercat.outputs(|bytes| word(bytes, address - OUTPUTS)),
        SLAVES..SLAVES_END => {
            let nth = usize::from((address - SLAVES) / 2);
            Some(if (address - SLAVES).is_multiple_of(2) {
                ethercat.state_word(nth)
            } else {
                age(ethercat, nth)
            })
        }
        _ => None,
    }
}

fn word(bytes: &[u8], nth: u16) -> Option<u16> {
    let (words, _) = bytes.as_chunks();
    words.get(usize::from(nth)).map(|word| u16::from_be_bytes(*word))
}

/// In tenths of a second, as the age of a point.
fn age(ethercat: &EthercatState, nth: usize) -> u16 {
    let last =
        ethercat.slave_status(nth).map(|status| status.last_response).filter(|last| *last != Instant::MIN);
    age_register(last.map(|last| last.elapsed()))
}
