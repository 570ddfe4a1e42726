//! The drive test: a MainDevice gives one Modbus drive a new value, waits until it reads it back, and goes on to the next, for
//! days.
//!
//! All of the gateway runs: SubDevice, EtherCAT port, scanner, router, serial port. Of the cycles of the MainDevice those are left
//! out that change nothing: the outputs are those that the gateway has, and the inputs those that the MainDevice has. So
//! nothing happens in them, and what remains happens at the very moments at which it would.

use std::array;

use embassy_time::{Duration, Instant, Timer};
use ethercat_subdevice::device::Device as Description;
use ethercat_subdevice::sub_device::SubDevice;
use ethercrab::subdevice_group::{Op, PreOp};
use mobgate::fieldbus::{DEVICE, EthercatState, GatewayObjects};

use crate::rig::{Size, with_gateway_of};
use crate::sub_device::{Dispatcher, Group, cable, direct, line_of, spawn, with_master};
use crate::world::Activity;
use crate::{Device, Random};

static GATEWAY: Description = DEVICE;

/// Time that the line and the drive need for a poll and a write at 4800 baud.
const SLOWEST: Duration = Duration::from_millis(150);
/// And is given up by then.
const GIVEN_UP: Duration = Duration::from_secs(60);
/// The drive's unit id, and its four holding registers.
const UNIT: u8 = 1;
const FIRST: u16 = 9_005;
const REGISTERS: usize = 4;
/// The process data watchdog's time: it would take the cycles that are left out for a MainDevice that is gone.
const WATCHDOG: u16 = 0x0420;
/// Outputs and inputs of one SubDevice were exchanged.
const WORKING_COUNTER: u16 = 3;

/// The image of the drive's registers.
type Image = [u8; 2 * REGISTERS];

/// Under which conditions it drives.
#[derive(Debug, Clone, Copy)]
pub struct Conditions {
    /// Of the serial line.
    pub baud: u32,
    /// The drive's polling time.
    pub polling_ms: u32,
    /// The MainDevice's.
    pub cycle: Duration,
}

impl Conditions {
    /// Those that are usual in a factory.
    pub const USUAL: Self = Self { baud: 19_200, polling_ms: 1_000, cycle: Duration::from_millis(1) };

    /// A value that takes longer is an error: until it is written, until the next poll is over, and as long again.
    pub fn longest(&self) -> Duration {
        SLOWEST.max(Duration::from_millis(self.polling_ms.into())) * 3
    }
}

/// What came of it.
#[derive(Debug, Clone, Copy, Default)]
pub struct Outcome {
    /// Values that were read back.
    pub values: u64,
    /// The longest time from a new value to its read-back.
    pub worst: Duration,
    /// Values that took longer than [`Conditions::longest`], cycles without the working counter that is expected, values that the drive
    /// got more than once or not as they were sent.
    pub errors: u64,
    /// Cycles that were not left out.
    pub cycles: u64,
    /// Requests that the drive has executed.
    pub requests: u64,
}

/// Drives for `time`, with values and the pause before each, up to `pause`, that `seed` draws. Now and then `progress` is told
/// how much of the time has passed.
pub fn drive(
    conditions: Conditions,
    seed: u64,
    time: Duration,
    pause: Duration,
    progress: impl FnMut(Duration),
) -> Outcome {
    let settings = format!(
        "port bus serial uart1 rtu client {} 8E1
        port ecat ethercat
        route ecat 1-247 * * bus",
        conditions.baud
    );
    let size = Size { frames: 32, connections: 0, rests: Duration::from_millis(1), ..Size::default() };
    with_gateway_of(size, seed, &settings, |world, rig| {
        let drive = Device::new(UNIT);
        rig.attach(world, "uart1", [drive.clone()]);
        let line = line_of(&GATEWAY);
        let (esc, interrupt) = direct(line.borrow().chip(0));
        let place = rig.gateway.ethercat().expect("the rig has the place");
        spawn(world, SubDevice::new(&GATEWAY, esc, GatewayObjects::new(place)), interrupt);
        let activity = world.activity();
        with_master(world, cable(line), async |dispatcher| {
            let group = dispatcher.to_pre_op().await.expect("a cable without faults");
            configure(&dispatcher, &group, conditions).await;
            let group = dispatcher.to_op(group, 0).await.expect("a cable without faults");
            let cycle = conditions.cycle;
            let master = Master { dispatcher: &dispatcher, group: &group, place, activity: &activity, cycle };
            let longest = conditions.longest();
            let run = Run { drive: &drive, random: Random::new(seed), time, pause, longest, progress };
            run.run(&master).await
        })
    })
}

async fn configure(dispatcher: &Dispatcher<'_>, group: &Group<PreOp>, conditions: Conditions) {
    let gateway = group.subdevice(dispatcher.master, 0).expect("there is one");
    let write = async |index, sub, value: u16| {
        gateway.sdo_write(index, sub, value).await.expect("a value in its range");
    };
    write(0x2000, 1, 1).await;
    for (sub, value) in [(1, UNIT.into()), (8, REGISTERS as u16), (9, FIRST)] {
        write(0x2001, sub, value).await;
    }
    gateway.sdo_write(0x2001, 10, conditions.polling_ms).await.expect("a value in its range");
    gateway.sdo_write(0x2020, 1, conditions.baud).await.expect("a value in its range");
    write(0x2005, 1, 1).await;
    gateway.register_write(WATCHDOG, 0_u16).await.expect("a cable without faults");
}

/// A MainDevice that leaves cycles out.
struct Master<'m> {
    dispatcher: &'m Dispatcher<'m>,
    group: &'m Group<Op>,
    place: &'m EthercatState,
    activity: &'m Activity,
    cycle: Duration,
}

impl Master<'_> {
    fn put(&self, image: Image) {
        let gateway = self.group.subdevice(self.dispatcher.master, 0).expect("there is one");
        gateway.outputs_raw_mut()[..image.len()].copy_from_slice(&image);
    }

    /// The next cycle, at its place in the raster: the inputs, and whether the gateway has taken part.
    async fn cycle(&self) -> (Image, bool) {
        let now = Instant::now().as_ticks();
        Timer::at(Instant::from_ticks(now.next_multiple_of(self.cycle.as_ticks()))).await;
        let response = self.group.tx_rx(self.dispatcher.master).await.expect("a cable without faults");
        let gateway = self.group.subdevice(self.dispatcher.master, 0).expect("there is one");
        let inputs = *gateway.inputs_raw().first_chunk().expect("the inputs are longer");
        (inputs, response.working_counter == WORKING_COUNTER)
    }

    /// Leaves the cycles out before which the gateway has nothing else than these `inputs`, at most until `limit`.
    async fn skip(&self, inputs: &Image, limit: Instant) {
        let same = || self.place.inputs(|now| now.starts_with(inputs));
        while same() && Instant::now() < limit {
            self.activity.settled().await;
        }
    }
}

/// The run of a drive test.
struct Run<'r, P> {
    drive: &'r Device,
    random: Random,
    time: Duration,
    pause: Duration,
    longest: Duration,
    progress: P,
}

impl<P: FnMut(Duration)> Run<'_, P> {
    async fn run(mut self, master: &Master<'_>) -> Outcome {
        let mut outcome = Outcome::default();
        // What the drive held before is written over first, by what no input is before it was read.
        let mut value = [0xff; 2 * REGISTERS];
        self.change(master, value, &mut Outcome::default()).await;
        let start = Instant::now();
        while start.elapsed() < self.time {
            Timer::after_micros(self.random.within(0..=self.pause.as_micros())).await;
            value = self.next(value);
            self.change(master, value, &mut outcome).await;
            if outcome.values % 1_000 == 0 {
                (self.progress)(start.elapsed());
            }
        }
        outcome.requests = self.drive.counters().all_requests();
        outcome
    }

    /// Another value for each register.
    fn next(&mut self, last: Image) -> Image {
        let random: Image = self.random.bits().to_le_bytes();
        array::from_fn(|nth| if random[nth] == last[nth] { !last[nth] } else { random[nth] })
    }

    /// Sends `value` until it is read back.
    async fn change(&self, master: &Master<'_>, value: Image, outcome: &mut Outcome) {
        self.drive.take_writes();
        let since = Instant::now();
        let limit = since + GIVEN_UP;
        master.put(value);
        loop {
            let (inputs, good) = master.cycle().await;
            outcome.cycles += 1;
            outcome.errors += u64::from(!good);
            if inputs == value {
                break;
            }
            if Instant::now() >= limit {
                outcome.errors += 1;
                return;
            }
            master.skip(&inputs, limit).await;
        }
        let took = since.elapsed();
        outcome.values += 1;
        outcome.worst = outcome.worst.max(took);
        outcome.errors += u64::from(took > self.longest) + u64::from(!self.got_once(value));
    }

    /// Whether the drive got `value`, once.
    fn got_once(&self, value: Image) -> bool {
        let [high, low] = FIRST.to_be_bytes();
        let wanted = [&[16, high, low, 0, REGISTERS as u8, 2 * REGISTERS as u8], &value[..]].concat();
        let writes = self.drive.take_writes();
        writes.len() == 1 && writes[0].pdu == wanted
    }
}
