//! Types for state that tasks share.

use core::cell::RefCell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::mutex;

use crate::settings::Settings;

/// A value that several tasks read and change, in a critical section.
pub(crate) type Shared<T> = Mutex<CriticalSectionRawMutex, RefCell<T>>;

/// Settings being changed, loaded or saved: by one task at a time, which may wait for a store.
pub(crate) type Draft = mutex::Mutex<CriticalSectionRawMutex, Settings>;
