//! The gateway as firmware on QEMU's mps2-an386, with devices at its UARTs and clients in its network, on the wall clock.

use mobgate_qemu::{Bus, Machine, Options};

mod audit;
mod board;
mod clients;
mod common;
mod ethercat;
#[path = "../../../../boards/linux/tests/web/http.rs"]
mod http;
#[path = "../../../../boards/linux/tests/ssh/openssh_client.rs"]
mod openssh_client;
#[path = "../../../../boards/linux/tests/ssh/payload.rs"]
mod payload;
mod points;
#[path = "../../../../boards/linux/tests/ssh/raw.rs"]
mod raw;
mod routing;
mod ssh;
mod web;

/// A board with its first settings and units 1 to 3, 65 to 67 and 129 to 131 on its three lines.
struct Bench {
    // Ended before its folder goes.
    machine: Machine,
    buses: [Bus; 3],
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        let bench = Self::unwired();
        bench.wire();
        bench
    }

    /// The devices are there, and not connected.
    fn unwired() -> Self {
        Self::told(tempfile::tempdir().unwrap(), "")
    }

    /// The same in `folder`; the board is told `words`.
    fn told(folder: tempfile::TempDir, words: &str) -> Self {
        let machine =
            Machine::start(folder.path(), Options { words: words.to_owned(), ..Options::default() });
        let buses = [1, 65, 129].map(|first| Bus::new(first..first + 3));
        Self { machine, buses, folder }
    }

    fn wire(&self) {
        (1..).zip(&self.buses).for_each(|(uart, bus)| self.machine.wire(uart, bus));
    }

    /// Switches the board off and on again.
    fn restart(&mut self) {
        self.machine.kill();
        self.machine = Machine::start(self.folder.path(), Options::default());
        self.wire();
    }
}

/// The response to a read of `count` registers from `address` on.
fn registers(unit: u8, address: u8, count: u8) -> Vec<u8> {
    let values = (address..address + count).flat_map(|address| [unit, address]);
    [3, 2 * count].into_iter().chain(values).collect()
}
