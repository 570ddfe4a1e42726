//! The connectors of a board: the console's terminal, and stations on the RS-485 lines.

use std::time::Duration;

use crate::character::{CONSOLE, Character, Format};
use crate::chip::Family;
use crate::gpio::Pin;
use crate::machine::{Machine, Stop};
use crate::time::{self, Time};

/// A UART of the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Uart {
    /// The RS-485 line `uart1`: USART2.
    Line1,
    /// The RS-485 line `uart2`: USART6.
    Line2,
    /// The RS-485 line `uart3`: UART4.
    Line3,
    /// The RS-485 line `uart4`: UART5.
    Line4,
    /// The console: USART3.
    Console,
}

/// A character that the board sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sent {
    /// The beginning of its start bit.
    pub begin: Duration,
    /// The end of its last stop bit.
    pub end: Duration,
    /// What it was.
    pub character: Character,
}

/// The pins that switch the transceivers' drivers: PD4, PG12, PA15, PC8.
const DRIVERS: [Pin; 4] = [(3, 4), (6, 12), (0, 15), (2, 8)];
/// How often a wait looks.
const STEP: Duration = Duration::from_millis(1);

/// Whether the last that the terminal shows is the prompt: it begins a line, and is longer while settings are not saved. The cursor's place
/// follows it.
pub fn ends_with_prompt(shown: &str) -> bool {
    shown.contains("> \x1b[K") && shown.ends_with('C')
}

impl Machine {
    /// Another station sends these bytes without gaps, from now on or behind what it sends already.
    pub fn send(&mut self, uart: Uart, bytes: &[u8], format: Format) {
        self.send_through(uart, bytes, format, false);
    }

    /// The same with noise in each character, of which the board's receiver can make out all bits.
    pub fn send_noisy(&mut self, uart: Uart, bytes: &[u8], format: Format) {
        self.send_through(uart, bytes, format, true);
    }

    fn send_through(&mut self, uart: Uart, bytes: &[u8], format: Format, is_noisy: bool) {
        let mut bus = self.bus.borrow_mut();
        let now = bus.now;
        let uart = &mut bus.uarts[uart as usize];
        let mut end = uart.arrives_until().map_or(now, |end| end.max(now));
        for &data in bytes {
            end += format.time(format.bits());
            uart.arrive(end, Character { format, data }, is_noisy);
        }
    }

    /// What the board sent on a line, which is forgotten.
    pub fn sent(&mut self, uart: Uart) -> Vec<Sent> {
        let sent = std::mem::take(&mut self.bus.borrow_mut().uarts[uart as usize].sent);
        let out = |sent: crate::usart::Sent| Sent {
            begin: time::duration(sent.begin),
            end: time::duration(sent.end),
            character: sent.character,
        };
        sent.into_iter().map(out).collect()
    }

    /// When the driver of a line's transceiver was switched, and to what.
    pub fn driver(&self, line: Uart) -> Vec<(Duration, bool)> {
        let bus = self.bus.borrow();
        let changes: &[(Time, bool)] = match bus.board.family {
            // The UARTs of the F4 cannot switch a driver.
            Family::F4 => bus.gpio.changes(DRIVERS[line as usize]),
            Family::F7 | Family::H7 => &bus.uarts[line as usize].driver,
        };
        changes.iter().map(|&(at, on)| (time::duration(at), on)).collect()
    }

    /// Runs until the board has sent `count` characters on a line, at most for so long, and returns them.
    pub fn receive(&mut self, uart: Uart, count: usize, at_most: Duration) -> Result<Vec<Sent>, Stop> {
        let end = self.now() + at_most;
        while self.now() < end && self.bus.borrow().uarts[uart as usize].sent.len() < count {
            self.run(STEP)?;
        }
        Ok(self.sent(uart))
    }

    /// Runs until what the terminal has shown is `enough`, at most for so long, and returns it.
    fn watch(&mut self, enough: impl Fn(&str) -> bool, at_most: Duration) -> Result<String, Stop> {
        let end = self.now() + at_most;
        let mut shown = String::new();
        loop {
            shown.extend(self.sent(Uart::Console).iter().map(|sent| char::from(sent.character.data)));
            if enough(&shown) {
                return Ok(shown);
            }
            if self.now() >= end {
                let what = format!("the terminal shows {shown:?} within {at_most:?}; the program is");
                return Err(Stop::Fault(format!("{what} {}", self.place())));
            }
            self.run(STEP)?;
        }
    }

    /// Runs until the terminal shows the prompt, at most for so long, and returns what it showed before.
    pub fn wait_for_prompt(&mut self, at_most: Duration) -> Result<String, Stop> {
        let mut shown = self.watch(ends_with_prompt, at_most)?;
        shown.truncate(shown.rfind("\rmobgate").unwrap_or(shown.len()));
        Ok(shown)
    }

    /// Types a line and returns what the terminal shows between it and the next prompt.
    pub fn type_line(&mut self, line: &str) -> Result<String, Stop> {
        self.send(Uart::Console, line.as_bytes(), CONSOLE);
        self.send(Uart::Console, b"\r", CONSOLE);
        let shown = self.wait_for_prompt(Duration::from_secs(10))?;
        let echo = format!("{line}\r\n");
        Ok(shown.split_once(&echo).map_or(shown.clone(), |(_, behind)| behind.to_owned()))
    }

    /// Whether the receiver of a UART has noticed noise, since the board last cleared that.
    pub fn has_noise(&self, uart: Uart) -> bool {
        self.bus.borrow().uarts[uart as usize].has_noise()
    }

    /// Speed and format that the board has set.
    pub fn format(&self, uart: Uart) -> Format {
        self.bus.borrow().uarts[uart as usize].format()
    }
}
