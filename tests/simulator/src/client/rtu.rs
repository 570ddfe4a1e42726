//! Responses in RTU over TCP.

use super::reply::Reply;
use crate::device::rtu;

/// Takes the first whole frame off the front: the first bytes with a good CRC. It has no transaction id.
pub(super) fn take_frame(received: &mut Vec<u8>) -> Option<Reply> {
    let good = |end: &usize| rtu::open(&received[..*end]).is_some_and(|(_, pdu)| pdu.len() >= shortest(pdu));
    let end = (0..=received.len()).find(good)?;
    let frame: Vec<u8> = received.drain(..end).collect();
    rtu::open(&frame).map(|(unit, pdu)| Reply { transaction: 0, protocol: 0, unit, pdu: pdu.to_vec() })
}

/// Bytes that a response with this beginning has at least: the beginning of one may have a right CRC by chance.
fn shortest(pdu: &[u8]) -> usize {
    match *pdu {
        [1..=4 | 17 | 23, count, ..] => 2 + usize::from(count),
        [5 | 6 | 15 | 16, ..] => 5,
        [22, ..] => 7,
        _ => 2,
    }
}
