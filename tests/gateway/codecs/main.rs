//! The Modbus codecs: the specifications' own examples, and properties that hold for all inputs.

mod ascii;
mod block;
mod ends;
mod pdu;
mod prelude;
mod rtu;
mod rtu_request;
mod rtu_response;
mod samples;
mod tcp;
