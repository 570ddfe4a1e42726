//! NOR flash that keeps its rules and can lose its power at any word written and any sector erased.
//!
//! Words are written once between two erasures, as flash with error correction demands, but for zeros. A cut leaves the word or the
//! sector that it hits in the state that a [`Torn`] names.

use std::cell::RefCell;
use std::rc::Rc;

use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

use crate::random::Random;

const BLANK: u8 = 0xff;

/// What a cut leaves of the word that is being written, or of the sector that is being erased.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Torn {
    /// What was there before.
    Before,
    /// Each bit as before or after, by chance.
    Bits,
    /// Something else at each read, as a word whose error correction fails.
    Unreadable,
    /// Changed from its beginning up to somewhere.
    Front,
    /// Changed from somewhere to its end.
    Back,
}

impl Torn {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Before, Self::Bits, Self::Unreadable, Self::Front, Self::Back];
}

/// A flash of words of `WORD` bytes in sectors of `SECTOR` bytes. Clones are handles of the same flash.
#[derive(Debug, Clone)]
pub struct SimFlash<const WORD: usize, const SECTOR: usize>(Rc<RefCell<State>>);

#[derive(Debug, Clone)]
struct State {
    bytes: Vec<u8>,
    /// Of each word: whether it was written since it was erased, and whether it reads differently each time.
    words: Vec<(bool, bool)>,
    /// Steps until the power fails, and what that leaves.
    cut: Option<(u64, Torn)>,
    steps: u64,
    sectors_erased: u64,
    bytes_read: u64,
    random: Random,
}

/// The power is off, or the access breaks the flash's rules.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PowerCut;

impl NorFlashError for PowerCut {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl<const WORD: usize, const SECTOR: usize> SimFlash<WORD, SECTOR> {
    /// `sectors` erased sectors; what cuts leave is drawn from `seed`.
    pub fn new(sectors: usize, seed: u64) -> Self {
        let bytes = sectors * SECTOR;
        Self(Rc::new(RefCell::new(State {
            bytes: vec![BLANK; bytes],
            words: vec![(false, false); bytes / WORD],
            cut: None,
            steps: 0,
            sectors_erased: 0,
            bytes_read: 0,
            random: Random::new(seed),
        })))
    }

    /// Another flash with the same content, whose cuts are drawn from `seed`.
    pub fn copy(&self, seed: u64) -> Self {
        Self(Rc::new(RefCell::new(State { random: Random::new(seed), ..self.0.borrow().clone() })))
    }

    /// Words written and sectors erased so far.
    pub fn steps(&self) -> u64 {
        self.0.borrow().steps
    }

    /// Sectors erased so far.
    pub fn sectors_erased(&self) -> u64 {
        self.0.borrow().sectors_erased
    }

    /// Bytes read so far.
    pub fn bytes_read(&self) -> u64 {
        self.0.borrow().bytes_read
    }

    /// Lets the power fail in the step after the next `steps`.
    pub fn cut_after(&self, steps: u64, torn: Torn) {
        self.0.borrow_mut().cut = Some((steps, torn));
    }

    /// Switches the power on, for good.
    pub fn power_on(&self) {
        self.0.borrow_mut().cut = None;
    }
}

impl State {
    /// Changes the bytes from `at` on to `to`, in one step.
    fn step(&mut self, at: usize, to: &[u8], word: usize) -> Result<(), PowerCut> {
        let erases = to.len() > word;
        match &mut self.cut {
            Some((0, torn)) => {
                let torn = std::mem::replace(torn, Torn::Before);
                self.tear(at, to, torn, word);
                return Err(PowerCut);
            }
            Some((left, _)) => *left -= 1,
            None => {}
        }
        self.steps += 1;
        self.sectors_erased += u64::from(erases);
        self.bytes[at..at + to.len()].copy_from_slice(to);
        self.words[at / word..(at + to.len()) / word].fill((!erases, false));
        Ok(())
    }

    fn tear(&mut self, at: usize, to: &[u8], torn: Torn, word: usize) {
        if torn == Torn::Before {
            return;
        }
        let border = self.random.index(to.len());
        let share = [0.1, 0.5, 0.9][self.random.index(3)];
        for (nth, (byte, &new)) in self.bytes[at..].iter_mut().zip(to).enumerate() {
            let changed = match (torn, nth < border) {
                (Torn::Front, true) | (Torn::Back, false) => BLANK,
                (Torn::Front, false) | (Torn::Back, true) => 0,
                _ => (0..8).fold(0, |mask, bit| mask | (u8::from(self.random.chance(share)) << bit)),
            };
            *byte = (*byte & !changed) | (new & changed);
        }
        for (word, bytes) in
            self.words[at / word..].iter_mut().zip(self.bytes[at..at + to.len()].chunks(word))
        {
            *word = (bytes.iter().any(|&byte| byte != BLANK), torn == Torn::Unreadable);
        }
    }
}

impl<const WORD: usize, const SECTOR: usize> ErrorType for SimFlash<WORD, SECTOR> {
    type Error = PowerCut;
}

impl<const WORD: usize, const SECTOR: usize> ReadNorFlash for SimFlash<WORD, SECTOR> {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), PowerCut> {
        let state = &mut *self.0.borrow_mut();
        state.bytes_read += bytes.len() as u64;
        for (place, byte) in (offset as usize..).zip(bytes) {
            let (_, unreadable) = state.words[place / WORD];
            *byte = if unreadable { state.random.byte() } else { state.bytes[place] };
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.0.borrow().bytes.len()
    }
}

impl<const WORD: usize, const SECTOR: usize> NorFlash for SimFlash<WORD, SECTOR> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = SECTOR;

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), PowerCut> {
        assert!((offset as usize | bytes.len()).is_multiple_of(WORD), "whole words are written");
        let state = &mut *self.0.borrow_mut();
        for (at, word) in (offset as usize..).step_by(WORD).zip(bytes.chunks(WORD)) {
            // All zeros over anything are all zeros again, or unreadable as before.
            let (written, unreadable) = state.words[at / WORD];
            assert!(!written || word.iter().all(|&byte| byte == 0), "the word at {at:#x} is written twice");
            state.step(at, word, WORD)?;
            state.words[at / WORD].1 = unreadable;
        }
        Ok(())
    }

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), PowerCut> {
        assert!((from | to).is_multiple_of(SECTOR as u32), "whole sectors are erased");
        (from as usize..to as usize)
            .step_by(SECTOR)
            .try_for_each(|at| self.0.borrow_mut().step(at, &[BLANK; SECTOR], WORD))
    }
}
