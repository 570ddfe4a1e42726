//! A NOR flash in memory, whose power can be cut in the middle of an operation.

use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};
use embedded_storage_async::nor_flash as asynch;

/// The power was cut.
#[derive(Debug)]
pub(crate) struct Cut;

impl NorFlashError for Cut {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

/// Bytes of a page: what the boot loader copies at a time.
pub(crate) const PAGE: usize = 4096;
/// Bytes of a word. The fewer there are, the sooner the power was cut at each of them.
pub(crate) const WORD: usize = 64;

/// Memory cells, with error correction or without.
#[derive(Clone)]
pub(crate) struct Flash<const ECC: bool> {
    pub(crate) cells: Vec<u8>,
    /// Erasures and words programmed so far.
    pub(crate) operations: usize,
    /// The operation that is cut off in its middle.
    pub(crate) cut_at: usize,
    /// Words that error correction refuses: they read as zeros.
    torn: Vec<usize>,
}

impl<const ECC: bool> Flash<ECC> {
    pub(crate) fn new(pages: usize) -> Self {
        Self { cells: vec![0xff; pages * PAGE], operations: 0, cut_at: usize::MAX, torn: Vec::new() }
    }

    /// Whether this operation is cut off; those after it do not happen.
    fn begin(&mut self) -> Result<bool, Cut> {
        let cut = self.operations == self.cut_at;
        if self.operations > self.cut_at {
            return Err(Cut);
        }
        self.operations += 1;
        Ok(cut)
    }

    fn program(&mut self, at: usize, word: &[u8]) -> Result<(), Cut> {
        let cut = self.begin()?;
        let cells = &mut self.cells[at..at + WORD];
        let is_blank = cells.iter().all(|&byte| byte == 0xff) && !self.torn.contains(&at);
        assert!(!ECC || is_blank, "the word at {at:#x} is programmed twice");
        assert!(cells.iter().zip(word).all(|(old, new)| new & !old == 0), "at {at:#x} without an erasure");
        let done = if cut { 0x55 } else { 0xff };
        cells.iter_mut().zip(word).for_each(|(old, new)| *old &= new | !done);
        if cut && ECC {
            self.torn.push(at);
        }
        if cut { Err(Cut) } else { Ok(()) }
    }

    fn erase_page(&mut self, at: usize) -> Result<(), Cut> {
        let cut = self.begin()?;
        for (nth, word) in self.cells[at..at + PAGE].chunks_mut(WORD).enumerate() {
            let at = at + nth * WORD;
            if !cut || nth % 2 == 0 {
                word.fill(0xff);
                self.torn.retain(|&torn| torn != at);
            } else {
                word.iter_mut().for_each(|byte| *byte |= 0x55);
                self.torn.extend(ECC.then_some(at));
            }
        }
        if cut { Err(Cut) } else { Ok(()) }
    }
}

impl<const ECC: bool> ErrorType for Flash<ECC> {
    type Error = Cut;
}

impl<const ECC: bool> ReadNorFlash for Flash<ECC> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Cut> {
        for (at, byte) in (offset as usize..).zip(bytes) {
            *byte = if self.torn.contains(&(at - at % WORD)) { 0 } else { self.cells[at] };
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.cells.len()
    }
}

impl<const ECC: bool> NorFlash for Flash<ECC> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = PAGE;

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Cut> {
        let at = offset as usize;
        assert!(at.is_multiple_of(WORD) && bytes.len().is_multiple_of(WORD));
        bytes.chunks(WORD).enumerate().try_for_each(|(nth, word)| self.program(at + nth * WORD, word))
    }

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Cut> {
        (from as usize..to as usize).step_by(PAGE).try_for_each(|at| self.erase_page(at))
    }
}

impl<const ECC: bool> asynch::ReadNorFlash for Flash<ECC> {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Cut> {
        ReadNorFlash::read(self, offset, bytes)
    }

    fn capacity(&self) -> usize {
        self.cells.len()
    }
}

impl<const ECC: bool> asynch::NorFlash for Flash<ECC> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = PAGE;

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Cut> {
        NorFlash::write(self, offset, bytes)
    }

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Cut> {
        NorFlash::erase(self, from, to)
    }
}
