//! The public function codes (Application Protocol V1.1b3, clause 5.1), their names, and which of them may be repeated.

/// 01: read coils.
pub const READ_COILS: u8 = 1;
/// 02: read discrete inputs.
pub const READ_DISCRETE_INPUTS: u8 = 2;
/// 03: read holding registers.
pub const READ_HOLDING_REGISTERS: u8 = 3;
/// 04: read input registers.
pub const READ_INPUT_REGISTERS: u8 = 4;
/// 05: write one coil.
pub const WRITE_SINGLE_COIL: u8 = 5;
/// 06: write one register.
pub const WRITE_SINGLE_REGISTER: u8 = 6;
/// 07: read eight status outputs of a device.
pub const READ_EXCEPTION_STATUS: u8 = 7;
/// 08: tests and counters, by sub-function.
pub const DIAGNOSTICS: u8 = 8;
/// 0B: status word and number of completed messages.
pub const GET_COMM_EVENT_COUNTER: u8 = 11;
/// 0C: the same, with the log of events.
pub const GET_COMM_EVENT_LOG: u8 = 12;
/// 0F: write several coils.
pub const WRITE_MULTIPLE_COILS: u8 = 15;
/// 10: write several registers.
pub const WRITE_MULTIPLE_REGISTERS: u8 = 16;
/// 11: the device's name and run state.
pub const REPORT_SERVER_ID: u8 = 17;
/// 14: read records of files.
pub const READ_FILE_RECORD: u8 = 20;
/// 15: write records of files.
pub const WRITE_FILE_RECORD: u8 = 21;
/// 16: change single bits of a register.
pub const MASK_WRITE_REGISTER: u8 = 22;
/// 17: write registers, then read registers.
pub const READ_WRITE_MULTIPLE_REGISTERS: u8 = 23;
/// 18: read a queue of registers without emptying it.
pub const READ_FIFO_QUEUE: u8 = 24;
/// 2B: a tunnel, by MEI type.
pub const ENCAPSULATED_INTERFACE: u8 = 43;

/// MEI type of function 43: read device identification.
pub const MEI_DEVICE_IDENTIFICATION: u8 = 14;

/// Whether `request` makes sense as a broadcast, which has no response (Serial Line 2.1: broadcasts are writes).
///
/// Includes diagnostics (8), as a restart may be meant for all. Unknown codes are left to the user.
pub fn is_broadcastable(request: &[u8]) -> bool {
    !is_read(request) && !matches!(request, [] | [READ_WRITE_MULTIPLE_REGISTERS | ENCAPSULATED_INTERFACE, ..])
}

/// The part of `request`, a write, that its response repeats; `None` for functions whose response has more (clause 6).
pub fn confirmation(request: &[u8]) -> Option<&[u8]> {
    match *request.first()? {
        WRITE_SINGLE_COIL | WRITE_SINGLE_REGISTER | WRITE_MULTIPLE_COILS | WRITE_MULTIPLE_REGISTERS => {
            request.get(..5)
        }
        MASK_WRITE_REGISTER => request.get(..7),
        _ => None,
    }
}

/// Whether `request` changes nothing, so that repeating it is harmless.
///
/// False for diagnostics (8), whose sub-functions restart the device and clear its counters; for the tunnel (43) except device
/// identification, because its MEI type 13 carries CANopen writes; and for unknown codes.
pub const fn is_read(request: &[u8]) -> bool {
    matches!(
        *request,
        [
            READ_COILS
                | READ_DISCRETE_INPUTS
                | READ_HOLDING_REGISTERS
                | READ_INPUT_REGISTERS
                | READ_EXCEPTION_STATUS
                | GET_COMM_EVENT_COUNTER
                | GET_COMM_EVENT_LOG
                | REPORT_SERVER_ID
                | READ_FILE_RECORD
                | READ_FIFO_QUEUE,
            ..
        ] | [ENCAPSULATED_INTERFACE, MEI_DEVICE_IDENTIFICATION, ..]
    )
}

/// The function's name for logs; an exception has the name of its function.
pub const fn name(function: u8) -> &'static str {
    match function & !super::EXCEPTION_BIT {
        READ_COILS => "read coils",
        READ_DISCRETE_INPUTS => "read discrete inputs",
        READ_HOLDING_REGISTERS => "read holding registers",
        READ_INPUT_REGISTERS => "read input registers",
        WRITE_SINGLE_COIL => "write single coil",
        WRITE_SINGLE_REGISTER => "write single register",
        READ_EXCEPTION_STATUS => "read exception status",
        DIAGNOSTICS => "diagnostics",
        GET_COMM_EVENT_COUNTER => "get comm event counter",
        GET_COMM_EVENT_LOG => "get comm event log",
        WRITE_MULTIPLE_COILS => "write multiple coils",
        WRITE_MULTIPLE_REGISTERS => "write multiple registers",
        REPORT_SERVER_ID => "report server id",
        READ_FILE_RECORD => "read file record",
        WRITE_FILE_RECORD => "write file record",
        MASK_WRITE_REGISTER => "mask write register",
        READ_WRITE_MULTIPLE_REGISTERS => "read/write multiple registers",
        READ_FIFO_QUEUE => "read FIFO queue",
        ENCAPSULATED_INTERFACE => "encapsulated interface transport",
        _ => "unlisted function",
    }
}
