//! What somebody at the gateway's console types, and what comes of it.

use std::convert::Infallible;

use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{ErrorType, Read, Write};
use mobgate::console::{Mode, run};
use mobgate::gateway::Gateway;
use mobgate::hal::{Store, StoreError, System};

/// Types `text` at a console of `gateway`, and gives what it prints.
pub async fn typed(gateway: &Gateway<'_>, text: &str) -> String {
    typed_slowly(gateway, &[(Duration::from_ticks(0), text)]).await
}

/// Types texts at a console of `gateway`, each after a pause, and gives what it prints.
pub async fn typed_slowly(gateway: &Gateway<'_>, texts: &[(Duration, &str)]) -> String {
    let mut terminal = Terminal { typed: b"", later: texts, since: Instant::now(), printed: Vec::new() };
    let Ok(()) = run(gateway, &mut terminal, &mut NoStore, &Simulator, Mode::Plain).await;
    String::from_utf8_lossy(&terminal.printed).into_owned()
}

struct Terminal<'t> {
    typed: &'t [u8],
    later: &'t [(Duration, &'t str)],
    /// Since when nothing is typed: a read may be given up and begun again.
    since: Instant,
    printed: Vec<u8>,
}

impl ErrorType for Terminal<'_> {
    type Error = Infallible;
}

impl Read for Terminal<'_> {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, Infallible> {
        if let (true, [(pause, text), later @ ..]) = (self.typed.is_empty(), self.later) {
            Timer::at(self.since + *pause).await;
            (self.typed, self.later, self.since) = (text.as_bytes(), later, Instant::now());
        }
        let count = self.typed.len().min(into.len());
        let (now, later) = self.typed.split_at(count);
        into[..count].copy_from_slice(now);
        self.typed = later;
        Ok(count)
    }
}

impl Write for Terminal<'_> {
    async fn write(&mut self, from: &[u8]) -> Result<usize, Infallible> {
        self.printed.extend_from_slice(from);
        Ok(from.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

/// Nothing is saved in a simulation.
struct NoStore;

impl Store for NoStore {
    async fn read(&mut self, _offset: usize, _into: &mut [u8]) -> Result<usize, StoreError> {
        Ok(0)
    }

    async fn append(&mut self, _text: &[u8]) -> Result<(), StoreError> {
        Err(StoreError::Absent("this is a simulation"))
    }

    async fn commit(&mut self) -> Result<(), StoreError> {
        Err(StoreError::Absent("this is a simulation"))
    }
}

struct Simulator;

impl System for Simulator {
    fn name(&self) -> &str {
        "simulator"
    }

    fn reboot(&self) {}
}
