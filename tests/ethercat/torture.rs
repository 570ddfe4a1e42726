//! Random worlds: a MainDevice gone mad, a line that loses frames, a chip whose bus fails, all drawn from a seed.
//!
//! Whatever happens, outputs are whole and never older than the ones before, and as soon as the faults end, a MainDevice that means it
//! brings the device to Op.

use embassy_time::with_timeout;
use ethercat_subdevice::lan9252::Lan9252 as Driver;
use mobgate_simulator::esc::cable::{Cable, FrameFaults, SharedSegment};
use mobgate_simulator::esc::frame::{Builder, datagrams};
use mobgate_simulator::esc::{DirectPdi, Interrupt};
use mobgate_simulator::lan9252::SpiFaults;
use mobgate_simulator::share::{Share, each_world};
use mobgate_simulator::sub_device::{BusFaults, Faulty};

use crate::prelude::*;

/// Worlds of a plain `cargo test`.
const WORLDS: u64 = 100;
/// Of the images that the chip took, in whichever state, so many come to the application, in per cent.
const GOOD_MIN: f64 = 30.0;
/// How long a MainDevice that means it may take to Op.
const RECOVERY: Duration = Duration::from_secs(10);
const IMAGE_BYTES: usize = 120;
const LOGICAL: u32 = 0;

#[test]
fn random_worlds_never_show_a_wrong_image_and_always_come_back_to_op() {
    each_world(WORLDS, "ethercat_torture", GOOD_MIN, live);
}

fn live(seed: u64, share: &Share) {
    let mut random = Random::new(seed);
    let mut world = World::new(seed);
    let line = line_of(&GATEWAY);
    let echo = SharedEcho::default();
    let chip = line.borrow().chip(0);
    let end_of_faults: Box<dyn Fn()> = if random.chance(0.5) {
        let pauses = Paced::new(DirectPdi::new(chip.clone()), random.fork(), 0..=random.within(0..=30));
        let faults = Rc::new(RefCell::new(bus_faults(&mut random)));
        let esc = Faulty::new(pauses, faults.clone(), random.fork());
        spawn(&world, SubDevice::new(&GATEWAY, esc, echo.clone()), Interrupt::new(chip));
        Box::new(move || *faults.borrow_mut() = BusFaults::NONE)
    } else {
        let lan9252 = Lan9252::new(chip, Timing::USUAL);
        let faults = spi_faults(&mut random);
        // As boards run it; only where bits turn on the SPI must outputs be read twice.
        echo.0.borrow_mut().proves = faults.flipped > 0.0;
        lan9252.set_faults(faults, random.fork());
        let esc = Driver::new(lan9252.spi(), Wiring::default());
        let sub_device = SubDevice::new(&GATEWAY, esc, echo.clone());
        spawn(&world, sub_device, lan9252.interrupt());
        Box::new(move || lan9252.set_faults(SpiFaults::default(), Random::new(0)))
    };
    let faults = frame_faults(&mut random);
    let cable = Cable::new(line.clone(), Duration::from_micros(50)).with_faults(faults, random.fork());
    let mut madness = Madness { cable, random, images: 0, taken: 0, repeat: false };
    let last = world.run_until(madness.rage());
    let given = echo.0.borrow().images - echo.0.borrow().again;
    share.add(given as u32, madness.taken);
    end_of_faults();
    recover(&mut world, line, last);
    let echo = echo.0.borrow();
    assert_eq!((echo.torn, echo.old), (0, 0), "seed {seed}: {echo:?}");
}

/// A MainDevice that means it: to Op, and a few images.
fn recover(world: &mut World<'_>, line: SharedSegment, last: u64) {
    with_master(world, cable(line), async |dispatcher| {
        let to_op = async {
            let group = dispatcher.to_pre_op().await.expect("PreOp is reached");
            let device = group.subdevice(dispatcher.master, 0).unwrap();
            device.sdo_write(0x1c32, 1, 0x01u16).await.expect("synchronisation is set");
            device.sdo_write(0x1c33, 1, 0x22u16).await.expect("synchronisation is set");
            dispatcher.to_op(group, last + 1).await.expect("Op is reached")
        };
        let group = with_timeout(RECOVERY, to_op).await.expect("Op is reached in time");
        for number in last + 2..last + 12 {
            let (inputs, counter) = dispatcher.exchange(&group, number).await.expect("images are exchanged");
            assert_eq!(counter, 3);
            // The first ones were written before Op.
            let of_now = inputs.is_some_and(|inputs| inputs + 2 >= number || number < last + 4);
            assert!(of_now, "inputs are of now: {inputs:?} with {number}");
            Timer::after_millis(2).await;
        }
    });
}

fn bus_faults(random: &mut Random) -> BusFaults {
    let mut probability = || [0.0, 0.0001, 0.001, 0.01][random.index(4)];
    BusFaults { failing: probability(), stuck: probability(), slow: probability(), slow_us: 0..=2_000 }
}

fn spi_faults(random: &mut Random) -> SpiFaults {
    SpiFaults {
        flipped: [0.0, 0.000_001, 0.000_01][random.index(3)],
        failed: [0.0, 0.0001, 0.001, 0.01][random.index(4)],
    }
}

fn frame_faults(random: &mut Random) -> FrameFaults {
    let mut probability = || [0.0, 0.01, 0.1][random.index(3)];
    FrameFaults {
        lost: probability(),
        corrupt: probability(),
        doubled: probability(),
        delayed: probability(),
        delay_us: 0..=3_000,
    }
}

/// A MainDevice that does anything, in any order.
struct Madness {
    cable: Cable,
    random: Random,
    images: u64,
    /// Of the images, those that the chip took and answered.
    taken: u32,
    repeat: bool,
}

impl Madness {
    /// Rages for a while; the number of the last image.
    async fn rage(&mut self) -> u64 {
        let end = Instant::now() + Duration::from_millis(self.random.within(100..=1_500));
        self.map().await;
        while Instant::now() < end {
            match self.random.index(16) {
                0 => self.request_state().await,
                1 => self.climb().await,
                2 => self.set_up().await,
                3 => self.switch().await,
                4 => self.message().await,
                5 => self.settings().await,
                6 => self.map().await,
                7 | 8 => self.fetch().await,
                9 => self.wait().await,
                _ => self.exchange().await,
            }
        }
        self.images
    }

    async fn write(&mut self, address: u16, bytes: &[u8]) {
        let frame = Builder::default().device(Command::Apwr, 0, address, bytes).build();
        self.cable.carry(frame).await;
    }

    async fn request_state(&mut self) {
        const LIKELY: [u8; 9] = [0x01, 0x02, 0x04, 0x08, 0x11, 0x12, 0x14, 0x18, 0x03];
        let likely = LIKELY[self.random.index(LIKELY.len())];
        let control = if self.random.chance(0.9) { likely } else { self.random.byte() };
        self.write(0x0120, &[control, 0]).await;
    }

    /// What a MainDevice does that wants to be in Op.
    async fn climb(&mut self) {
        for control in [0x11, 0x12, 0x14, 0x18] {
            for channel in Channel::ALL {
                self.set_up_channel(channel).await;
            }
            self.write(0x0120, &[control, 0]).await;
            Timer::after_millis(1).await;
            self.exchange().await;
        }
    }

    async fn set_up(&mut self) {
        let channel = Channel::ALL[self.random.index(4)];
        self.set_up_channel(channel).await;
    }

    async fn set_up_channel(&mut self, channel: Channel) {
        let [start_low, start_high] = GATEWAY.memory.start(channel).to_le_bytes();
        let [low, high] = GATEWAY.default_bytes(channel).to_le_bytes();
        let block = [start_low, start_high, low, high, channel.control(), 0, 1, 0];
        self.write(channel.registers(), &block).await;
    }

    /// Switches a SyncManager on or off, or asks for a repetition.
    async fn switch(&mut self) {
        if self.random.chance(0.7) {
            self.repeat = !self.repeat;
            self.write(0x080e, &[1 | u8::from(self.repeat) << 1]).await;
        } else {
            let channel = Channel::ALL[self.random.index(4)];
            let on = u8::from(self.random.chance(0.5));
            self.write(channel.registers() + 6, &[on]).await;
        }
    }

    async fn message(&mut self) {
        let mut message: Vec<u8> = (0..128).map(|_| self.random.byte()).collect();
        if self.random.chance(0.8) {
            // Something that is at least an upload.
            let counter = self.random.index(8) as u8;
            message[..12].copy_from_slice(&[10, 0, 0, 0, 0, counter << 4 | 3, 0, 0x20, 0x40, 0x08, 0x10, 0]);
        } else {
            // Anything but a download: settings are changed by `settings` alone.
            message[8] |= 0x40;
        }
        self.write(GATEWAY.memory.start(Channel::MailboxOut), &message).await;
    }

    /// Settings that every MainDevice copes with: other PDOs of the same size, free run.
    async fn settings(&mut self) {
        let pdo = self.random.index(2) as u8;
        let sdo = match self.random.index(4) {
            0 => [0x33, 0x12, 0x1c, 0, 1, 0, pdo, 0x16],
            1 => [0x33, 0x13, 0x1c, 0, 1, 0, pdo, 0x1a],
            2 => [0x2b, 0x32, 0x1c, 1, pdo, 0, 0, 0],
            _ => [0x2b, 0x33, 0x1c, 1, pdo, 0, 0, 0],
        };
        let mut message = vec![10, 0, 0, 0, 0, 3, 0, 0x20];
        message.extend(sdo);
        message.resize(128, 0);
        self.write(GATEWAY.memory.start(Channel::MailboxOut), &message).await;
    }

    async fn fetch(&mut self) {
        let address = GATEWAY.memory.start(Channel::MailboxIn);
        let frame = Builder::default().device(Command::Aprd, 0, address, &[0; 128]).build();
        self.cable.carry(frame).await;
    }

    /// Outputs and inputs, one behind the other in the logical address space.
    async fn map(&mut self) {
        for (nth, channel) in [Channel::Outputs, Channel::Inputs].into_iter().enumerate() {
            let mut fmmu = (LOGICAL + (nth * IMAGE_BYTES) as u32).to_le_bytes().to_vec();
            fmmu.extend([IMAGE_BYTES as u8, 0, 0, 7]);
            fmmu.extend(GATEWAY.memory.start(channel).to_le_bytes());
            fmmu.extend([0, 2 - nth as u8, 1, 0, 0, 0]);
            self.write(0x0600 + 16 * nth as u16, &fmmu).await;
        }
    }

    async fn exchange(&mut self) {
        self.images += 1;
        let mut data = image(self.images, IMAGE_BYTES);
        data.resize(2 * IMAGE_BYTES, 0);
        let frame = Builder::default().logical(Command::Lrw, LOGICAL, &data).build();
        for mut back in self.cable.carry(frame).await {
            for datagram in datagrams(&mut back) {
                assert!(datagram.counter() <= 3);
                self.taken += u32::from(datagram.counter() == 3);
            }
        }
    }

    async fn wait(&mut self) {
        let us = [100, 1_000, 10_000, 150_000][self.random.index(4)];
        Timer::after_micros(self.random.within(0..=us)).await;
    }
}
