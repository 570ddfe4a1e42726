//! Which mutant is awake in this process: `MUTANT` in the environment names it. The mutated copy depends on this crate.
//!
//! With `MUTANTS_SEEN` each place that the process comes by is written into that file once instead.
#![feature(const_eval_select, core_intrinsics)]
#![allow(internal_features)]

use std::fs::File;
use std::io::Write;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};

const UNREAD: u32 = u32::MAX;
const RECORDING: u32 = u32::MAX - 1;

static AWAKE: AtomicU32 = AtomicU32::new(UNREAD);
static SEEN: [AtomicBool; 1 << 16] = [const { AtomicBool::new(false) }; 1 << 16];
static FILE: Mutex<Option<File>> = Mutex::new(None);

/// Whether mutant `id` is awake; what the compiler computes is the original.
#[inline]
pub const fn on(id: u32) -> bool {
    core::intrinsics::const_eval_select((id,), while_compiling, while_running)
}

const fn while_compiling(_id: u32) -> bool {
    false
}

#[inline]
fn while_running(id: u32) -> bool {
    let awake = AWAKE.load(Relaxed);
    if awake < RECORDING { awake == id } else { first_time(id) }
}

#[cold]
fn first_time(id: u32) -> bool {
    if AWAKE.load(Relaxed) == UNREAD {
        let mut file = FILE.lock().unwrap();
        let awake = match std::env::var_os("MUTANTS_SEEN") {
            Some(path) => {
                file.get_or_insert_with(|| File::options().append(true).create(true).open(path).unwrap());
                RECORDING
            }
            None => std::env::var("MUTANT").map_or(0, |id| id.parse().unwrap()),
        };
        AWAKE.store(awake, Relaxed);
    }
    if AWAKE.load(Relaxed) < RECORDING {
        return AWAKE.load(Relaxed) == id;
    }
    if !SEEN[id as usize].swap(true, Relaxed) {
        let mut file = FILE.lock().unwrap();
        file.as_mut().unwrap().write_all(format!("{id}\n").as_bytes()).unwrap();
    }
    false
}
