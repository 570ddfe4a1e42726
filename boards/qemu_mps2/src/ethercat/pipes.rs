//! Two named pipes on the host, to and from a program there.

use cortex_m_semihosting::{nr, syscall};

use crate::semihosting::{File, HostError};

/// The board's ends of the pipes.
pub(super) struct Pipes {
    input: File,
    output: File,
}

impl Pipes {
    /// Opens `path.in` for reading and `path.out` for writing. Stalls the board until the other ends are open.
    pub(super) fn open(path: &str) -> Result<Self, HostError> {
        let input = File::open_as(path, ".in", nr::open::R_BINARY)?;
        Ok(Self { input, output: File::open_as(path, ".out", nr::open::W_TRUNC_BINARY)? })
    }

    /// Writes `question`, and fills `answer` with the response. Stalls the board until then.
    pub(super) fn ask(&mut self, question: &[u8], answer: &mut [u8]) -> Result<(), HostError> {
        // SAFETY: pointer and length belong to a slice that outlives the call; the same holds for the next call.
        let missing = unsafe { syscall!(WRITE, self.output.0, question.as_ptr(), question.len()) };
        if missing > 0 {
            return Err(HostError);
        }
        let mut rest = answer;
        while !rest.is_empty() {
            // SAFETY: as above.
            let missing = unsafe { syscall!(READ, self.input.0, rest.as_mut_ptr(), rest.len()) };
            let count = rest.len().checked_sub(missing).filter(|count| *count > 0).ok_or(HostError)?;
            rest = &mut rest[count..];
        }
        Ok(())
    }
}
