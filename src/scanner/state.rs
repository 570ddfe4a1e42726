//! A scanner shared by tasks: the port that sends its requests, and the users of its values.

use core::cell::RefCell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;

use super::Scanner;

/// A shared scanner. Boards keep it in a static; it is all zeros at start.
pub struct ScannerState {
    scanner: Mutex<CriticalSectionRawMutex, RefCell<Scanner>>,
    /// Something may have been marked.
    changed: Signal<CriticalSectionRawMutex, ()>,
}

impl ScannerState {
    /// A scanner without rows.
    pub const fn new() -> Self {
        Self { scanner: Mutex::new(RefCell::new(Scanner::new())), changed: Signal::new() }
    }

    /// Calls `f` with the scanner.
    pub fn with<R>(&self, f: impl FnOnce(&mut Scanner) -> R) -> R {
        self.scanner.lock(|scanner| f(&mut scanner.borrow_mut()))
    }

    /// Calls `f`, which may mark rows, with the scanner, and wakes the port.
    pub fn change<R>(&self, f: impl FnOnce(&mut Scanner) -> R) -> R {
        let result = self.with(f);
        self.changed.signal(());
        result
    }

    /// Waits until something may have been marked.
    pub async fn changed(&self) {
        self.changed.wait().await;
    }
}
