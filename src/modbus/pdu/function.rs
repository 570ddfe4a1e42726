//! The public function codes (Application Protocol V1.1b3, clause 5.1), in a table with the form of their requests and responses.
//! All rules about functions derive from it.

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

/// A public function.
#[derive(Debug, Clone, Copy)]
pub struct Function {
    /// Its code.
    pub code: u8,
    /// Its name for logs.
    pub name: &'static str,
    /// The form of its requests and responses.
    pub form: Form,
}

/// The form of a function's requests and responses, which determines their effect. Sizes include the function code.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// Address and quantity; the response has a byte count and that many bytes of data.
    Read(Cells),
    /// Address and value; the response repeats both.
    WriteOne(Cells),
    /// Address, quantity, byte count and data; the response repeats the first two.
    WriteMany(Cells),
    /// Address and two masks; the response repeats all.
    MaskWrite,
    /// A combined read and write.
    ReadWrite {
        /// The cells to read.
        read: Cells,
        /// The cells to write.
        write: Cells,
    },
    /// An address; the response has the number of bytes and of registers in two bytes each.
    ReadFifo,
    /// The code alone; the response has this many bytes.
    Status(usize),
    /// The code alone; the response has a byte count.
    Report,
    /// The same, with the events after three words (clause 6.10).
    EventLog,
    /// A sub-function and data.
    Diagnostics,
    /// Byte count and groups; the response has groups of the requested lengths.
    ReadFile,
    /// Byte count and groups; the response repeats all.
    WriteFile,
    /// An MEI type and its data.
    Tunnel,
}

/// The size of a cell, and the most cells of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cells {
    /// 1 or 16.
    pub bits: u8,
    /// Most in one request.
    pub most: u16,
}

impl Cells {
    /// Bytes of `quantity` cells.
    pub fn bytes(self, quantity: u16) -> usize {
        (usize::from(quantity) * usize::from(self.bits)).div_ceil(8)
    }
}

/// Coils or discrete inputs, up to `most`.
const fn bits(most: u16) -> Cells {
    Cells { bits: 1, most }
}

/// Registers, up to `most`.
const fn registers(most: u16) -> Cells {
    Cells { bits: 16, most }
}

/// All public functions.
pub const FUNCTIONS: [Function; 19] = {
    const fn row(code: u8, name: &'static str, form: Form) -> Function {
        Function { code, name, form }
    }
    [
        row(READ_COILS, "read coils", Form::Read(bits(2000))),
        row(READ_DISCRETE_INPUTS, "read discrete inputs", Form::Read(bits(2000))),
        row(READ_HOLDING_REGISTERS, "read holding registers", Form::Read(registers(125))),
        row(READ_INPUT_REGISTERS, "read input registers", Form::Read(registers(125))),
        row(WRITE_SINGLE_COIL, "write single coil", Form::WriteOne(bits(1))),
        row(WRITE_SINGLE_REGISTER, "write single register", Form::WriteOne(registers(1))),
        row(READ_EXCEPTION_STATUS, "read exception status", Form::Status(2)),
        row(DIAGNOSTICS, "diagnostics", Form::Diagnostics),
        row(GET_COMM_EVENT_COUNTER, "get comm event counter", Form::Status(5)),
        row(GET_COMM_EVENT_LOG, "get comm event log", Form::EventLog),
        row(WRITE_MULTIPLE_COILS, "write multiple coils", Form::WriteMany(bits(1968))),
        row(WRITE_MULTIPLE_REGISTERS, "write multiple registers", Form::WriteMany(registers(123))),
        row(REPORT_SERVER_ID, "report server id", Form::Report),
        row(READ_FILE_RECORD, "read file record", Form::ReadFile),
        row(WRITE_FILE_RECORD, "write file record", Form::WriteFile),
        row(MASK_WRITE_REGISTER, "mask write register", Form::MaskWrite),
        row(
            READ_WRITE_MULTIPLE_REGISTERS,
            "read/write multiple registers",
            Form::ReadWrite { read: registers(125), write: registers(121) },
        ),
        row(READ_FIFO_QUEUE, "read FIFO queue", Form::ReadFifo),
        row(ENCAPSULATED_INTERFACE, "encapsulated interface transport", Form::Tunnel),
    ]
};

/// The highest code in the table.
#[allow(clippy::indexing_slicing)] // Evaluated at build time, where an overrun is a compile error.
const HIGHEST: u8 = {
    let (mut highest, mut at) = (0, 0);
    while at < FUNCTIONS.len() {
        if FUNCTIONS[at].code > highest {
            highest = FUNCTIONS[at].code;
        }
        at += 1;
    }
    highest
};

/// Index + 1 of each code in the table, which is looked up several times per frame; 0: not in the table.
#[allow(clippy::indexing_slicing)] // Evaluated at build time, where an overrun is a compile error.
const INDEX: [u8; HIGHEST as usize + 1] = {
    let mut index = [0; HIGHEST as usize + 1];
    let mut at = 0;
    while at < FUNCTIONS.len() {
        index[FUNCTIONS[at].code as usize] = at as u8 + 1;
        at += 1;
    }
    index
};

impl Function {
    /// The function with this code; `None` for an exception.
    pub fn of(code: u8) -> Option<&'static Self> {
        let at = INDEX.get(usize::from(code))?.checked_sub(1)?;
        FUNCTIONS.get(usize::from(at))
    }
}

impl Form {
    /// The form of requests, or of normal responses, with the code of `pdu`.
    pub fn of(pdu: &[u8]) -> Option<Self> {
        Some(Function::of(*pdu.first()?)?.form)
    }
}

/// Whether `request` makes sense as a broadcast, which has no response (Serial Line 2.1: broadcasts are writes).
///
/// Includes diagnostics (8), as a restart may be meant for all. Unknown codes are left to the user.
pub fn is_broadcastable(request: &[u8]) -> bool {
    !request.is_empty()
        && !is_read(request)
        && !matches!(Form::of(request), Some(Form::ReadWrite { .. } | Form::Tunnel))
}

/// The part of `request`, a write, that its response repeats; `None` for functions whose response has more (clause 6).
pub fn confirmation(request: &[u8]) -> Option<&[u8]> {
    match Form::of(request)? {
        Form::WriteOne(_) | Form::WriteMany(_) => request.get(..5),
        Form::MaskWrite => request.get(..7),
        _ => None,
    }
}

/// Whether `request` changes nothing, so that repeating it is harmless.
///
/// False for diagnostics (8), whose sub-functions restart the device and clear its counters; for the tunnel (43) except device
/// identification, because its MEI type 13 carries CANopen writes; and for unknown codes.
pub fn is_read(request: &[u8]) -> bool {
    match Form::of(request) {
        Some(
            Form::Read(_) | Form::ReadFifo | Form::Status(_) | Form::Report | Form::EventLog | Form::ReadFile,
        ) => true,
        Some(Form::Tunnel) => request.get(1) == Some(&MEI_DEVICE_IDENTIFICATION),
        _ => false,
    }
}

/// Whether `so_far` begins a diagnostics request with a public sub-function and one word of data: all but 0, whose data may have
/// any length.
pub(super) fn is_public(so_far: &[u8]) -> bool {
    matches!(so_far, [_, 0, 1..=4 | 10..=18 | 20, ..])
}

/// The function's name for logs; an exception has the name of its function.
pub fn name(function: u8) -> &'static str {
    Function::of(function & !super::EXCEPTION_BIT).map_or("unlisted function", |function| function.name)
}
