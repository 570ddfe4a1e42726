//! An EtherCAT SubDevice on an emulated chip: an application that recognises each image, faults on the bus to the chip, and a
//! MainDevice that starts it.

mod clocked;
mod echo;
mod faulty;
#[cfg(feature = "ethercrab")] // Needs the ethercrab crate.
mod in_step;
mod paced;
#[cfg(feature = "ethercrab")]
mod start;

use std::cell::RefCell;
use std::rc::Rc;

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embedded_hal_async::digital::Wait;
use ethercat_subdevice::application::Application;
use ethercat_subdevice::device::Device;
use ethercat_subdevice::esc::Esc;
use ethercat_subdevice::sub_device::SubDevice;

use crate::cable::SharedSegment;
use crate::{Chip, DirectPdi, Interrupt, Kind, Segment, SharedChip};
use mobgate_world::World;

pub use clocked::{Clocked, note_pulses};
pub use echo::{Echo, SharedEcho, image, sequence};
pub use faulty::{BusFaults, Counted, Counts, Faulty};
#[cfg(feature = "ethercrab")]
pub use in_step::{InStep, StepGroup, StepSetup, exchange_in_step, in_step};
pub use paced::Paced;
#[cfg(feature = "ethercrab")]
pub use start::{
    AtPace, Dispatcher, Exchanged, Group, SpiCost, StartUp, at_cable, cable, exchange_at_pace,
    exchange_images, exchange_images_on, spi_traffic, start_up, with_master,
};

/// A line with one LAN9252 whose EEPROM describes `device`.
///
/// # Panics
/// If the device's description does not fit into the EEPROM.
pub fn line_of(device: &Device) -> SharedSegment {
    line_of_kind(Kind::LAN9252, device)
}

/// The same with another chip.
///
/// # Panics
/// As [`line_of`].
pub fn line_of_kind(kind: Kind, device: &Device) -> SharedSegment {
    Rc::new(RefCell::new(Segment::new([Chip::with_sii(kind, device)])))
}

/// Direct access to a chip, and its interrupt.
pub fn direct(chip: SharedChip) -> (DirectPdi, Interrupt) {
    (DirectPdi::new(chip.clone()), Interrupt::new(chip))
}

/// Runs a SubDevice woken by `interrupt`.
pub fn spawn<'w, const OUTPUTS: usize, const INPUTS: usize>(
    world: &World<'w>,
    mut sub_device: SubDevice<impl Esc + 'w, impl Application + 'w, OUTPUTS, INPUTS>,
    mut interrupt: Interrupt,
) {
    world.spawn(async move {
        sub_device
            .run(async || interrupt.wait_for_high().await.expect("the simulated line cannot fail"))
            .await
    });
}

/// The same with a processor that latches rising edges of `interrupt`, and never samples the level.
pub fn spawn_by_edges<'w, const OUTPUTS: usize, const INPUTS: usize>(
    world: &World<'w>,
    mut sub_device: SubDevice<impl Esc + 'w, impl Application + 'w, OUTPUTS, INPUTS>,
    mut interrupt: Interrupt,
) {
    let noted = Rc::new(Signal::<NoopRawMutex, ()>::new());
    let edges = noted.clone();
    world.spawn(async move {
        loop {
            interrupt.wait_for_rising_edge().await.expect("the simulated line cannot fail");
            edges.signal(());
        }
    });
    world.spawn(async move { sub_device.run(async || noted.wait().await).await });
}
