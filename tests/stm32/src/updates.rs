//! Images in the flash, as the program and the boot loader leave them.

use crate::chip::Family;
use crate::machine::Machine;

/// embassy-boot's mark of an image that waits, in each byte of the state's first word.
const SWAP: u8 = 0xf0;

impl Machine {
    /// The bytes of the program's part of the flash, up to the end of the program that was built.
    pub fn program(&self) -> Vec<u8> {
        let (active, _) = self.board.active;
        self.bus.borrow().flash.cells.read(active, self.program_bytes()).to_vec()
    }

    /// Puts `image` where an update waits, and marks it, as a program that has received it does.
    pub fn stage(&mut self, image: &[u8]) {
        let word = vec![SWAP; self.state_word_bytes()];
        let cells = &mut self.bus.borrow_mut().flash.cells;
        cells.put(self.board.update, image);
        cells.put(self.board.state, &word);
    }

    /// Bytes of a word of the state: the F7's driver writes four words of the flash at a time.
    fn state_word_bytes(&self) -> usize {
        if self.board.family == Family::F7 { 16 } else { self.flash_word_bytes() }
    }

    /// Bytes of a word that the flash programs at a time.
    pub fn flash_word_bytes(&self) -> usize {
        if self.board.family == Family::H7 { 32 } else { 4 }
    }

    /// Pages that the boot loader copies to swap two images, and the words of each.
    pub fn pages_to_swap(&self) -> (usize, usize) {
        let page_bytes = if self.board.family == Family::F7 { 256 << 10 } else { 128 << 10 };
        (2 * self.board.active.1 as usize / page_bytes, page_bytes / self.flash_word_bytes())
    }
}
