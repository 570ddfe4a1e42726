//! The EtherCAT process image as input registers of the own unit, for clients other than a MainDevice: the inputs read from the
//! slaves and the outputs to write, with the state and age of each. The table is in docs/registers.md.

use embassy_time::Instant;

use crate::fieldbus::EthercatState;
use crate::scanner::{DEVICES_MAX, age_register};

/// The first register of the inputs: two bytes each, high byte first.
pub const INPUTS: u16 = 0xe000;
/// The first register of the outputs.
pub const OUTPUTS: u16 = 0xe200;
/// The first register of slave 0; each slave has two: its state as in 2032h, and the age of its last response.
pub const SLAVES: u16 = 0xe400;
/// Images longer than 1024 bytes are truncated here.
const INPUTS_END: u16 = OUTPUTS;
const OUTPUTS_END: u16 = SLAVES;
const SLAVES_END: u16 = 0xe440;

const _: () = assert!(SLAVES + 2 * DEVICES_MAX as u16 <= SLAVES_END);

/// The register at `address`, if there is one.
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

/// In tenths of a second, like the age of a point.
fn age(ethercat: &EthercatState, nth: usize) -> u16 {
    let last =
        ethercat.slave_status(nth).map(|status| status.last_response).filter(|last| *last != Instant::MIN);
    age_register(last.map(|last| last.elapsed()))
}
