//! A board's memory for new firmware, which tests look into.

use std::cell::RefCell;
use std::rc::Rc;

use embassy_time::{Duration, Timer};
use mobgate::hal::{Update, UpdateError, Version};

/// The memory. Clones are the same one.
#[derive(Clone, Default)]
pub struct Firmware(Rc<RefCell<State>>);

#[derive(Default)]
struct State {
    /// What is being written, its length as announced, and whether it may be older.
    next: Option<(Vec<u8>, Option<u32>, bool)>,
    taken: Vec<Vec<u8>>,
    /// After so many bytes it is refused.
    refuses: Option<(usize, UpdateError)>,
    /// How long a write takes.
    pace: Duration,
    last: (Option<u32>, bool),
}

impl Firmware {
    /// The version of whatever it takes.
    pub const VERSION: &'static str = "9.8.7";

    /// Refuses what has `bytes`, or at the end what has fewer.
    pub fn refuse(&self, bytes: usize, why: UpdateError) {
        self.0.borrow_mut().refuses = Some((bytes, why));
    }

    /// Lets each write last so long.
    pub fn set_pace(&self, pace: Duration) {
        self.0.borrow_mut().pace = pace;
    }

    /// The images that were finished.
    pub fn taken(&self) -> Vec<Vec<u8>> {
        self.0.borrow().taken.clone()
    }

    /// How many bytes of an unfinished image there are.
    pub fn unfinished(&self) -> Option<usize> {
        self.0.borrow().next.as_ref().map(|(bytes, ..)| bytes.len())
    }

    /// The length that was announced last, and whether an older image was allowed.
    pub fn announced(&self) -> (Option<u32>, bool) {
        self.0.borrow().last
    }
}

impl Update for Firmware {
    async fn begin(&mut self, bytes: Option<u32>, allow_older: bool) -> Result<(), UpdateError> {
        let mut state = self.0.borrow_mut();
        state.last = (bytes, allow_older);
        state.next = Some((Vec::new(), bytes, allow_older));
        Ok(())
    }

    async fn write(&mut self, bytes: &[u8]) -> Result<(), UpdateError> {
        let pace = self.0.borrow().pace;
        Timer::after(pace).await;
        let mut state = self.0.borrow_mut();
        let refuses = state.refuses;
        let (written, ..) = state.next.as_mut().expect("a file was begun");
        written.extend_from_slice(bytes);
        match refuses {
            Some((after, why)) if written.len() >= after => {
                state.next = None;
                Err(why)
            }
            _ => Ok(()),
        }
    }

    async fn finish(&mut self) -> Result<Version, UpdateError> {
        let mut state = self.0.borrow_mut();
        let (written, length, _) = state.next.take().expect("a file was begun");
        if let Some((_, why)) = state.refuses {
            return Err(why);
        }
        if length.is_some_and(|length| length as usize > written.len()) {
            return Err(UpdateError::Truncated);
        }
        state.taken.push(written);
        Ok(Version::try_from(Self::VERSION).expect("a short text"))
    }

    fn discard(&mut self) {
        self.0.borrow_mut().next = None;
    }
}
