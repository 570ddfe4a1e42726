//! What many of these tests use.

pub(crate) use mobgate::modbus::pdu::{Misfit, ResponseLength, fits, response_length};
pub(crate) use mobgate::modbus::{PDU_BYTES_MAX, PduLength};
pub(crate) use proptest::collection::vec;
pub(crate) use proptest::prelude::*;
