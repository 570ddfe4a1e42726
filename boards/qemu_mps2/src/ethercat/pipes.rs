//! Two named pipes on the host, to and from a program there.
//!
//! A message begins with the number of bytes behind its head (16 bits, little-endian) and the number of the request. A program that
//! ended may have left a request or a response in a pipe; its number tells that a response is not of the last request.

use cortex_m_semihosting::{nr, syscall};

use crate::semihosting::{File, HostError};

/// Bytes before those of a message.
pub(super) const HEAD_BYTES: usize = 3;

/// The board's ends of the pipes.
pub(super) struct Pipes {
    input: File,
    output: File,
    /// Of the last request.
    number: u8,
}

impl Pipes {
    /// Opens `path.in` for reading and `path.out` for writing. Stalls the board until the other ends are open.
    pub(super) fn open(path: &str) -> Result<Self, HostError> {
        let input = File::open_as(path, ".in", nr::open::R_BINARY)?;
        Ok(Self { input, output: File::open_as(path, ".out", nr::open::W_TRUNC_BINARY)?, number: 0 })
    }

    /// Writes `request`, which has room for a head, and fills `response`, without its head. Stalls the board until then.
    pub(super) fn ask(&mut self, request: &mut [u8], response: &mut [u8]) -> Result<(), HostError> {
        self.number = self.number.wrapping_add(1);
        let (head, data) = request.split_at_mut_checked(HEAD_BYTES).ok_or(HostError)?;
        let [low, high] = (data.len() as u16).to_le_bytes();
        head.copy_from_slice(&[low, high, self.number]);
        // SAFETY: pointer and length belong to a slice that outlives the call; the same holds for the next call.
        let missing = unsafe { syscall!(WRITE, self.output.0, request.as_ptr(), request.len()) };
        if missing > 0 {
            return Err(HostError);
        }
        loop {
            let mut head = [0; HEAD_BYTES];
            self.read(&mut head)?;
            let [low, high, number] = head;
            let mut length = usize::from(u16::from_le_bytes([low, high]));
            if number == self.number && length == response.len() {
                return self.read(response);
            }
            while length > 0 {
                let mut stale = [0; 64];
                let count = length.min(stale.len());
                self.read(&mut stale[..count])?;
                length -= count;
            }
        }
    }

    fn read(&mut self, into: &mut [u8]) -> Result<(), HostError> {
        let mut rest = into;
        while !rest.is_empty() {
            // SAFETY: as above.
            let missing = unsafe { syscall!(READ, self.input.0, rest.as_mut_ptr(), rest.len()) };
            let count = rest.len().checked_sub(missing).filter(|count| *count > 0).ok_or(HostError)?;
            rest = &mut rest[count..];
        }
        Ok(())
    }
}
