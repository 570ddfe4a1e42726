//! The pins of the SYNC signals at a processor, and an application that notes when they make it act.

use embassy_time::{Duration, Timer};
use ethercat_subdevice::application::{Address, Application};
use ethercat_subdevice::clocks::SyncSignals;
use ethercat_subdevice::coe::abort::Abort;
use mobgate_world::World;

use super::{Echo, image};
use crate::{Nanos, SharedChip, SyncLine, SyncPin, now};

/// The SYNC signals of `chip` at a processor that takes `latency` to note an edge.
pub fn note_pulses(world: &World<'_>, chip: &SharedChip, latency: Duration) -> &'static SyncSignals {
    // As a board's static: there as long as the program.
    let signals: &SyncSignals = Box::leak(Box::new(SyncSignals::new()));
    for line in SyncLine::ALL {
        let mut pin = SyncPin::new(chip.clone(), line);
        world.spawn(async move {
            loop {
                pin.pulse().await;
                if latency > Duration::MIN {
                    Timer::after(latency).await;
                }
                match line {
                    SyncLine::Sync0 => signals.sync0(),
                    SyncLine::Sync1 => signals.sync1(),
                }
            }
        });
    }
    signals
}

/// Records images as an [`Echo`] does, and when outputs take effect; its inputs are numbered by the microsecond they are sampled at.
pub struct Clocked {
    /// What outputs were.
    pub echo: Echo,
    chip: SharedChip,
    /// Times from a pulse of SYNC0 to the outputs that take effect with it.
    pub after_pulse: Vec<Nanos>,
}

impl Clocked {
    /// An application behind `chip`.
    pub fn new(chip: SharedChip) -> Self {
        Self { echo: Echo::default(), chip, after_pulse: Vec::new() }
    }
}

impl Application for Clocked {
    fn read(&mut self, at: Address, into: &mut [u8]) -> Result<usize, Abort> {
        self.echo.read(at, into)
    }

    fn write(&mut self, _at: Address, _value: &[u8]) {}

    fn outputs(&mut self, pdo: u16, bytes: &[u8]) {
        let pulse = self.chip.borrow().pulses_at_pin(SyncLine::Sync0);
        self.after_pulse.extend(pulse.map(|(_, at)| now().saturating_sub(at)));
        self.echo.outputs(pdo, bytes);
    }

    fn inputs(&mut self, _pdo: u16, into: &mut [u8]) {
        into.copy_from_slice(&image(now() / 1_000, into.len()));
    }

    fn outputs_stopped(&mut self) {
        self.echo.outputs_stopped();
    }
}
