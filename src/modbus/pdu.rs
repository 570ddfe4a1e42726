//! The PDU, common to all framings: validity of requests, length of responses, and whether a response matches its request.
//!
//! Everything operates on PDUs, whose byte 0 is the function code. There is no state, and no function code is refused as unknown:
//! the public codes only serve to find the end of a response early and to check that it matches. Clauses are those of the
//! Application Protocol V1.1b3.

mod ahead;
mod block;
mod extent;
pub mod function;
mod request;
mod response;

pub use super::exception::EXCEPTION_BIT;
pub use ahead::{End, request_end, response_end};
pub use block::Block;
pub use extent::{Extent, Touched, addresses_end, touched};
pub use function::{confirmation, is_broadcastable, is_read, name as function_name};
pub(crate) use request::is_beyond_response;
pub use request::{check_request, request_length};
pub use response::{Misfit, ResponseLength, fits, response_length};

/// A record group in a function 20 request: reference type, file, record, length in registers.
const FILE_GROUP_BYTES: usize = 7;

/// Length of the response to a function 20 request with these groups (clause 6.14), each with its own length and reference type;
/// `None` when the groups are malformed or the response would not fit a PDU.
fn file_response_length(groups: &[u8]) -> Option<usize> {
    let (groups, rest) = groups.as_chunks::<FILE_GROUP_BYTES>();
    if groups.is_empty() || !rest.is_empty() {
        return None;
    }
    let mut length = 2;
    for [.., high, low] in groups {
        let registers = usize::from(u16::from_be_bytes([*high, *low]));
        if registers == 0 {
            return None;
        }
        length += 2 + 2 * registers;
    }
    (length <= super::PDU_BYTES_MAX).then_some(length)
}
