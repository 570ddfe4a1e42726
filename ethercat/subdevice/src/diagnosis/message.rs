//! A message of the diagnosis history, and its text.

/// Most bytes of parameters in a message.
pub const PARAMETERS_MAX: usize = 3;
/// Bytes of a message as read from the object.
pub const MESSAGE_BYTES: usize = 16 + 3 * PARAMETERS_MAX;

/// Manufacturer-specific codes, with the text's number in the high word.
const MANUFACTURER_CODE: u16 = 0xe000;
/// Message flag: local time stamp.
const LOCAL_TIME: u16 = 1 << 4;
/// Parameter type: unsigned 8-bit number.
const PARAMETER_U8: u16 = 0x0005;

/// Severity of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Severity {
    /// For information.
    Information = 0,
    /// Needs attention.
    Warning = 1,
    /// Faulty.
    Error = 2,
}

/// A text of the ESI file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Text {
    /// Its number; not 0.
    pub id: u16,
    /// Its severity.
    pub severity: Severity,
    /// The emergency's error code (CiA 301, 7.2.7.1).
    pub emergency: u16,
    /// In English, with `%d` for each parameter.
    pub text: &'static str,
}

/// A stored message; unused if its text is 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Message {
    pub(super) time_us: u64,
    pub(super) text: u16,
    pub(super) emergency: u16,
    /// The severity, and in the high nibble the number of parameters: packed, as a board has little room for 20 messages.
    kind: u8,
    pub(super) parameters: [u8; PARAMETERS_MAX],
}

const _: () = assert!(size_of::<Message>() == 16);

impl Message {
    pub(super) const NONE: Self =
        Self { time_us: 0, text: 0, emergency: 0, kind: 0, parameters: [0; PARAMETERS_MAX] };

    pub(super) fn new(text: &Text, parameters: &[u8]) -> Self {
        let count = parameters.len().min(PARAMETERS_MAX) as u8;
        let kind = text.severity as u8 | count << 4;
        let mut message = Self { text: text.id, emergency: text.emergency, kind, ..Self::NONE };
        message.parameters.iter_mut().zip(parameters).for_each(|(place, value)| *place = *value);
        message
    }

    pub(super) const fn severity(&self) -> u8 {
        self.kind & 0x0f
    }

    const fn count(&self) -> u8 {
        self.kind >> 4
    }

    pub(super) fn says_the_same_as(&self, other: &Self) -> bool {
        Self { time_us: other.time_us, ..*self } == *other
    }

    pub(super) fn write(&self, into: &mut [u8]) {
        if self.text == 0 {
            return;
        }
        let flags = u16::from(self.severity()) | LOCAL_TIME | u16::from(self.count()) << 8;
        let [code_low, code_high] = MANUFACTURER_CODE.to_le_bytes();
        let [text_low, text_high] = self.text.to_le_bytes();
        let [flags_low, flags_high] = flags.to_le_bytes();
        let head = [code_low, code_high, text_low, text_high, flags_low, flags_high, text_low, text_high];
        let time = (self.time_us * 1_000).to_le_bytes();
        let [type_low, type_high] = PARAMETER_U8.to_le_bytes();
        let parameters = self.parameters.iter().take(self.count().into());
        let parameters = parameters.flat_map(|value| [type_low, type_high, *value]);
        let bytes = head.into_iter().chain(time).chain(parameters);
        into.iter_mut().zip(bytes).for_each(|(place, byte)| *place = byte);
    }
}
