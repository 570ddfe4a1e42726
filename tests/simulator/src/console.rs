//! What somebody at the gateway's console types, and what comes of it.

use std::collections::VecDeque;
use std::convert::Infallible;

use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{ErrorType, Read, Write};
use mobgate::console::{Mode, run};
use mobgate::gateway::Gateway;
use mobgate::hal::{NoUpdate, Store, StoreError, System};

/// Types `text` at a console of `gateway`, and gives what it prints.
pub async fn typed(gateway: &Gateway<'_>, text: &str) -> String {
    typed_slowly(gateway, &[(Duration::from_ticks(0), text)]).await
}

/// Types each of `parts` so long after the one before, and gives what the console of `gateway` prints.
pub async fn typed_slowly(gateway: &Gateway<'_>, parts: &[(Duration, &str)]) -> String {
    typed_in(gateway, parts, Mode::Plain).await
}

/// The same at a terminal, which sends keys.
pub async fn typed_at_terminal(gateway: &Gateway<'_>, parts: &[(Duration, &str)]) -> String {
    typed_in(gateway, parts, Mode::Echo).await
}

async fn typed_in(gateway: &Gateway<'_>, parts: &[(Duration, &str)], mode: Mode<'_>) -> String {
    let mut at = Instant::now();
    let parts = parts.iter().map(|&(pause, text)| {
        at += pause;
        (at, text.as_bytes())
    });
    let mut terminal = Terminal { parts: parts.collect(), printed: Vec::new() };
    let Ok(_) =
        run(gateway, &mut terminal, &mut NoStore, &mut NoUpdate("this is a simulation"), &Simulator, mode)
            .await;
    terminal.printed()
}

/// Who types at a console, and reads what it prints.
pub struct Terminal<'t> {
    /// What is typed, and when.
    parts: VecDeque<(Instant, &'t [u8])>,
    printed: Vec<u8>,
}

impl<'t> Terminal<'t> {
    /// Types `text` at once.
    pub fn of(text: &'t str) -> Self {
        Self { parts: [(Instant::now(), text.as_bytes())].into(), printed: Vec::new() }
    }

    /// What was printed so far.
    pub fn printed(&self) -> String {
        String::from_utf8_lossy(&self.printed).into_owned()
    }
}

impl ErrorType for Terminal<'_> {
    type Error = Infallible;
}

impl Read for Terminal<'_> {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, Infallible> {
        let Some(&(at, typed)) = self.parts.front() else { return Ok(0) };
        Timer::at(at).await;
        let (now, later) = typed.split_at(typed.len().min(into.len()));
        into[..now.len()].copy_from_slice(now);
        self.parts.pop_front();
        if !later.is_empty() {
            self.parts.push_front((at, later));
        }
        Ok(now.len())
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
pub struct NoStore;

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

/// A store in memory, whose power may be cut in the middle of a save.
#[derive(Debug, Default)]
pub struct Medium {
    /// The text that is saved.
    pub saved: Vec<u8>,
    /// The version being written.
    pub next: Vec<u8>,
    /// Calls until the power is cut, before or behind what the call does.
    pub calls_left: Option<(u64, bool)>,
}

impl Medium {
    /// Does `work`, unless the power is cut before; never returns if it is.
    async fn call(&mut self, work: impl FnOnce(&mut Self)) {
        if let Some((calls, late)) = &mut self.calls_left {
            if *calls == 0 {
                if *late {
                    work(self);
                }
                return std::future::pending().await;
            }
            *calls -= 1;
        }
        work(self);
    }
}

impl Store for Medium {
    async fn read(&mut self, offset: usize, into: &mut [u8]) -> Result<usize, StoreError> {
        let rest = self.saved.get(offset..).unwrap_or_default();
        let count = rest.len().min(into.len());
        into[..count].copy_from_slice(&rest[..count]);
        Ok(count)
    }

    async fn append(&mut self, text: &[u8]) -> Result<(), StoreError> {
        self.call(|medium| medium.next.extend_from_slice(text)).await;
        Ok(())
    }

    async fn commit(&mut self) -> Result<(), StoreError> {
        self.call(|medium| medium.saved = std::mem::take(&mut medium.next)).await;
        Ok(())
    }
}

/// A board that does nothing when it is to be restarted.
pub struct Simulator;

impl System for Simulator {
    fn name(&self) -> &str {
        "simulator"
    }

    fn reboot(&self) {}
}
