//! New firmware by `sb` of Debian's lrzsz, which sends the update file that was built, through a terminal of Linux.

use std::fs::File;
use std::io::{Read, Write};
use std::os::fd::AsFd;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use mobgate_stm32_emulator::{CONSOLE, Machine, NUCLEO_H743ZI, Uart, update_file};
use nix::poll::{PollFd, PollFlags, poll};
use nix::pty::openpty;
use nix::sys::termios::{SetArg, cfmakeraw, tcgetattr, tcsetattr};

use crate::started;

/// Longest time for the file at 115200 baud and the erasures of its pages.
const SENT_MAX: Duration = Duration::from_secs(120);
const STEP: Duration = Duration::from_millis(1);

/// A terminal of Linux, the far end of which is the board's console.
struct Terminal {
    line: File,
    sb: Child,
    /// Until when what `sb` has sent is on its way to the board.
    busy_until: Duration,
}

impl Terminal {
    /// One in which somebody starts `sb`.
    fn new(machine: &Machine) -> Self {
        let terminal = openpty(None, None).unwrap();
        let mut settings = tcgetattr(&terminal.slave).unwrap();
        cfmakeraw(&mut settings);
        tcsetattr(&terminal.slave, SetArg::TCSANOW, &settings).unwrap();
        let mut sb = Command::new("sb");
        sb.arg(update_file(NUCLEO_H743ZI)).stderr(Stdio::null());
        sb.stdin(terminal.slave.try_clone().unwrap()).stdout(terminal.slave);
        let sb = sb.spawn().expect("lrzsz is installed");
        Self { line: terminal.master.into(), sb, busy_until: machine.now() }
    }

    /// What `sb` has sent, if something comes within a millisecond: the board waits for it no shorter than in real time.
    fn read(&mut self) -> Option<Vec<u8>> {
        let mut bytes = [0; 2048];
        poll(&mut [PollFd::new(self.line.as_fd(), PollFlags::POLLIN)], 1_u8)
            .ok()
            .filter(|&count| count > 0)?;
        let count = self.line.read(&mut bytes).ok()?;
        Some(bytes[..count].to_vec())
    }

    /// A millisecond of the board's; what it sent.
    fn step(&mut self, machine: &mut Machine) -> Vec<u8> {
        if machine.now() >= self.busy_until
            && let Some(bytes) = self.read()
        {
            machine.send(Uart::Console, &bytes, CONSOLE);
            let bits = bytes.len() as u32 * CONSOLE.bits();
            self.busy_until = machine.now() + Duration::from_secs(bits.into()) / CONSOLE.baud as u32;
        }
        machine.run(STEP).unwrap();
        let sent: Vec<u8> = machine.sent(Uart::Console).into_iter().map(|sent| sent.character.data).collect();
        // Nobody reads it once `sb` has ended.
        let _ = self.line.write_all(&sent);
        sent
    }
}

#[test]
fn debians_sb_sends_the_update_file_that_was_built() {
    let mut machine = started(NUCLEO_H743ZI);
    machine.send(Uart::Console, b"update\r", CONSOLE);
    let asks = machine.receive(Uart::Console, usize::MAX, Duration::from_secs(4)).unwrap();
    assert_eq!(asks.last().map(|asks| asks.character.data), Some(b'C'));
    let mut terminal = Terminal::new(&machine);
    let (end, mut shown) = (machine.now() + SENT_MAX, String::new());
    while !shown.contains("0.1.0 is complete and genuine; it starts now, on trial") {
        assert!(machine.now() < end, "{shown:?}");
        shown.extend(terminal.step(&mut machine).into_iter().map(char::from));
    }
    assert!(terminal.sb.wait().unwrap().success());
}
