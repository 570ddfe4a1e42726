//! The data types of SSH (RFC 4251, 5).

use crate::Error;

/// Reads the fields of a message, one after the other.
pub(crate) struct Reader<'m>(&'m [u8]);

impl<'m> Reader<'m> {
    pub(crate) const fn new(message: &'m [u8]) -> Self {
        Self(message)
    }

    pub(crate) fn bytes(&mut self, count: usize) -> Result<&'m [u8], Error> {
        let (field, rest) = self.0.split_at_checked(count).ok_or(Error::MALFORMED)?;
        self.0 = rest;
        Ok(field)
    }

    pub(crate) fn byte(&mut self) -> Result<u8, Error> {
        let (byte, rest) = self.0.split_first().ok_or(Error::MALFORMED)?;
        self.0 = rest;
        Ok(*byte)
    }

    /// Any number but 0 is true.
    pub(crate) fn flag(&mut self) -> Result<bool, Error> {
        self.byte().map(|byte| byte != 0)
    }

    pub(crate) fn number(&mut self) -> Result<u32, Error> {
        let (number, rest) = self.0.split_first_chunk().ok_or(Error::MALFORMED)?;
        self.0 = rest;
        Ok(u32::from_be_bytes(*number))
    }

    pub(crate) fn string(&mut self) -> Result<&'m [u8], Error> {
        let length = self.number()?;
        self.bytes(length as usize)
    }

    pub(crate) fn text(&mut self) -> Result<&'m str, Error> {
        core::str::from_utf8(self.string()?).map_err(|_| Error::MALFORMED)
    }

    /// A string of exactly `N` bytes.
    pub(crate) fn array<const N: usize>(&mut self) -> Result<&'m [u8; N], Error> {
        self.string()?.try_into().map_err(|_| Error::MALFORMED)
    }
}

/// Writes the fields of a message. What does not fit is noted, and the message is not sent.
pub(crate) struct Writer<'b> {
    buffer: &'b mut [u8],
    length: usize,
    fits: bool,
}

impl<'b> Writer<'b> {
    pub(crate) const fn new(buffer: &'b mut [u8]) -> Self {
        Self { buffer, length: 0, fits: true }
    }

    /// How long the message is, if it has fitted.
    pub(crate) const fn finish(self) -> Option<usize> {
        if self.fits { Some(self.length) } else { None }
    }

    pub(crate) fn bytes(&mut self, bytes: &[u8]) -> &mut Self {
        match self.buffer.get_mut(self.length..).and_then(|free| free.get_mut(..bytes.len())) {
            Some(field) => {
                field.copy_from_slice(bytes);
                self.length += bytes.len();
            }
            None => self.fits = false,
        }
        self
    }

    pub(crate) fn byte(&mut self, byte: u8) -> &mut Self {
        self.bytes(&[byte])
    }

    pub(crate) fn flag(&mut self, flag: bool) -> &mut Self {
        self.byte(flag.into())
    }

    pub(crate) fn number(&mut self, number: u32) -> &mut Self {
        self.bytes(&number.to_be_bytes())
    }

    pub(crate) fn string(&mut self, bytes: &[u8]) -> &mut Self {
        self.number(bytes.len() as u32).bytes(bytes)
    }

    /// A public key or a signature of Ed25519: the type's name and `bytes`, in a string (RFC 8709, 4 and 6).
    pub(crate) fn ed25519(&mut self, bytes: &[u8]) -> &mut Self {
        let length = 2 * size_of::<u32>() + ED25519.len() + bytes.len();
        self.number(length as u32).string(ED25519.as_bytes()).string(bytes)
    }
}

/// The name of the only type of keys.
pub(crate) const ED25519: &str = "ssh-ed25519";

/// Whether `name` is one of a `list`, which is separated by commas.
pub(crate) fn has(list: &str, name: &str) -> bool {
    list.split(',').any(|listed| listed == name)
}
