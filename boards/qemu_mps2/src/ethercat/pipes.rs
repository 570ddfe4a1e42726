//! Two named pipes of the host, to a program there and back from it.

use cortex_m_semihosting::{nr, syscall};

use crate::semihosting::{File, HostError};

/// The board's ends of the pipes.
pub(super) struct Pipes {
    input: File,
    output: File,
}

impl Pipes {
    /// Opens `path.in`, to be read, and `path.out`, to be written. Everything stands still until the other ends are open.
    pub(super) fn open(path: &str) -> Result<Self, HostError> {
        let input = File::open_as(path, ".in", nr::open::R_BINARY)?;
        Ok(Self { input, output: File::open_as(path, ".out", nr::open::W_TRUNC_BINARY)? })
    }

    /// Writes `question`, and fills `answer` with what comes back. Everything stands still until then.
    pub(super) fn ask(&mut self, question: &[u8], answer: &mut [u8]) -> Result<(), HostError> {
        // SAFETY: pointer and length are those of a slice that outlives the call; so in the next one.
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
