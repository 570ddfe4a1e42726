//! A driver at a simulated LAN9252, with a segment in front of it.

use ethercat_subdevice::lan9252::Lan9252 as Driver;
use mobgate_simulator::esc::SharedSegment;
use mobgate_simulator::lan9252::Spi;

use mobgate_simulator::esc::samples::line;

use crate::prelude::*;

/// Runs `scenario` in a world of its own; afterwards the driver must have done nothing wrong.
pub(crate) fn with_driver<F: AsyncFnOnce(&mut Driver<Spi>, &Bench)>(timing: Timing, scenario: F) {
    let mut world = World::new(1);
    let segment = Rc::new(RefCell::new(line(1)));
    let chip = Lan9252::new(segment.borrow().chip(0), timing);
    let bench = Bench { segment, chip };
    let mut driver = Driver::new(bench.chip.spi(), Wiring::default());
    world.run_until(scenario(&mut driver, &bench));
    bench.chip.check();
}

/// The same, after the driver has started the chip and a MainDevice has set it up.
pub(crate) fn with_started<F: AsyncFnOnce(&mut Driver<Spi>, &Bench)>(timing: Timing, scenario: F) {
    with_driver(timing, async |driver, bench| {
        driver.events().await.unwrap();
        bench.set_up();
        scenario(driver, bench).await;
    });
}

/// What a scenario needs beside the driver.
pub(crate) struct Bench {
    pub(crate) segment: SharedSegment,
    pub(crate) chip: Lan9252,
}

impl Bench {
    /// Sets SyncManagers and FMMUs, which a reset clears.
    pub(crate) fn set_up(&self) {
        let mut segment = self.segment.borrow_mut();
        assert_eq!(segment.poke(0, 0x0800, &mobgate_simulator::esc::samples::MANAGERS), 1);
        assert_eq!(segment.poke(0, 0x0600, &mobgate_simulator::esc::samples::FMMUS), 1);
    }

    /// What the chip's memory holds.
    pub(crate) fn peek<const N: usize>(&self, address: u16) -> [u8; N] {
        self.segment.borrow().chip(0).borrow().peek(address)
    }
}
