//! ethercrab starts a SubDevice: from Init to Op, with the mapping that it reads by itself.

use embassy_time::{Duration, Instant, Timer};
use ethercrab::error::Error;
use mobgate::ethercat::application::Application;
use mobgate::ethercat::device::Device;
use mobgate::ethercat::esc::Esc;
use mobgate::ethercat::sync_manager::Channel;

use super::{Counted, image, line_of, spawn};
use crate::World;
use crate::esc::SharedChip;
use crate::esc::cable::Cable;
use crate::esc::master::{Storage, main_device, pump};

/// On its way, there and back.
const FRAME_TIME: Duration = Duration::from_micros(50);
/// Between two exchanges of process data while Op is waited for.
const CYCLE: Duration = Duration::from_millis(1);

/// What a start took.
#[derive(Debug, Clone, Copy)]
pub struct StartUp {
    /// From the first frame until Op was seen.
    pub time: Duration,
    /// Mailbox requests that were answered.
    pub round_trips: u64,
    /// Frames.
    pub frames: u64,
    /// The working counter of the exchange in Op.
    pub working_counter: u16,
}

/// Starts `device`, whose chip is reached by what `reach` makes.
///
/// # Errors
/// What the MainDevice says.
pub fn start_up<E: Esc + 'static>(
    device: &'static Device,
    reach: impl FnOnce(SharedChip) -> E,
    application: impl Application + 'static,
) -> Result<StartUp, Error> {
    let storage = Storage::new();
    let (tx, rx, pdu_loop) = storage.try_split().expect("it was not split before");
    let mut world = World::new(1);
    let segment = line_of(device);
    let chip = segment.borrow().chip(0);
    let esc = Counted::new(reach(chip.clone()), device.memory.start(Channel::MailboxOut));
    let counts = esc.counts();
    spawn(&world, device, chip, esc, application);
    let cable = Cable::new(segment, FRAME_TIME);
    let frames = cable.frames();
    world.spawn(pump(tx, rx, cable));
    let master = main_device(pdu_loop, 0);
    world.run_until(async {
        // The device starts its chip first.
        Timer::after_millis(100).await;
        let begin = Instant::now();
        let clock = || Instant::now().as_micros() * 1_000;
        let group = master.init_single_group::<2, 512>(clock).await?;
        let group = group.into_safe_op(&master).await?;
        let outputs = group.subdevice(&master, 0)?.outputs_raw().len();
        group.subdevice(&master, 0)?.outputs_raw_mut().copy_from_slice(&image(1, outputs));
        group.tx_rx(&master).await?;
        let group = group.request_into_op(&master).await?;
        loop {
            let exchange = group.tx_rx(&master).await?;
            if exchange.all_op() {
                let time = begin.elapsed();
                let round_trips = counts.watched.get();
                return Ok(StartUp {
                    time,
                    round_trips,
                    frames: frames.get(),
                    working_counter: exchange.working_counter,
                });
            }
            Timer::after(CYCLE).await;
        }
    })
}
