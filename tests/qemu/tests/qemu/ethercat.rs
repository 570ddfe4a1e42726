//! The board with an EtherCAT controller at its SPI, and without.

use std::time::{Duration, Instant};

use embassy_time::Timer;
use ethercrab::ObjectDescriptionListQuery;
use ethercrab::subdevice_group::{Op, PreOp};
use mobgate::fieldbus::DEVICE;
use mobgate_qemu::{Bus, Console, Controller, wait_for};
use mobgate_simulator::sub_device::{Dispatcher, Group};

use crate::{Bench, registers};

/// Of the MainDevice on the wall clock; what a cycle takes longer does no harm.
const CYCLE_MS: u64 = 2;
/// The watchdog of process data in units of 100 us: as long as a busy host may keep the MainDevice waiting.
const WATCHDOG: (u16, u16) = (0x0420, 60_000);
/// Longest until a start succeeds: a busy host gives the board and its controller a fifth of a processor.
const START_LIMIT: Duration = Duration::from_secs(30);
/// Longest until a value is seen on the other side: a host that is busy may let devices be taken for dead, and they are asked again
/// after 30 s at most.
const SEEN_LIMIT: Duration = Duration::from_secs(60);

/// Of the gateway, and what is before the first entry in a list of objects: the heads of mailbox, CoE, service and list.
const MAILBOX_BYTES: usize = 128;
const LIST_HEAD_BYTES: usize = 6 + 2 + 4 + 2;

/// What a MainDevice writes to 2001h and following: the unit, then count and first address of coils, discrete inputs, input and
/// holding registers. The devices are on two lines.
const DEVICES: [(u8, [u16; 9]); 2] = [(1, [1, 4, 0, 8, 0, 2, 10, 4, 20]), (65, [65, 0, 0, 0, 0, 1, 7, 3, 5])];
/// Where their values lie: coils, discrete inputs, input registers, holding registers.
const INPUT_BYTES: usize = 1 + 1 + 2 * 2 + 2 * 4 + 2 + 2 * 3;
const OUTPUT_BYTES: usize = 1 + 2 * 4 + 2 * 3;

/// The board with a controller, an `ethercat` port, and devices on its lines.
fn with_controller() -> (Bench, Controller, Console) {
    let folder = tempfile::tempdir().unwrap();
    let controller = Controller::start(folder.path());
    let bench = Bench::told(folder, &controller.word());
    bench.wire();
    let mut console = bench.machine.console();
    let lines = ["port ecat ethercat line P1", "route ecat 1-64 * * P1", "route ecat 65-128 * * P2"];
    for line in lines {
        assert_eq!(console.run(line), "", "{line}");
    }
    (bench, controller, console)
}

fn shows(console: &mut Console, command: &str, text: &str) {
    wait_for(&format!("{text:?} in {command}"), || console.run(command).contains(text).then_some(()));
}

/// What the board has read of the devices, as it lies in its input buffer.
fn expected_inputs(buses: &[Bus; 3]) -> Vec<u8> {
    let bits = |bits: &[bool]| bits.iter().rev().fold(0, |byte, bit| byte << 1 | u8::from(*bit));
    let words = |words: &[u16]| words.iter().flat_map(|word| word.to_be_bytes()).collect::<Vec<u8>>();
    let first = buses[0].with(1, |memory| {
        let bits = vec![bits(&memory.coils[0..4]), bits(&memory.discrete_inputs[0..8])];
        [bits, words(&memory.input[10..12]), words(&memory.holding[20..24])].concat()
    });
    let second =
        buses[1].with(65, |memory| [words(&memory.input[7..8]), words(&memory.holding[5..8])].concat());
    [first, second].concat()
}

/// What the devices have been written, as it lies in the output buffer.
fn written(buses: &[Bus; 3]) -> Vec<u8> {
    let inputs = expected_inputs(buses);
    [&inputs[..1], &inputs[6..14], &inputs[16..22]].concat()
}

/// Outputs that are others in each round.
fn outputs(round: u8) -> Vec<u8> {
    (0..OUTPUT_BYTES as u8)
        .map(|byte| if byte == 0 { round % 16 } else { byte.wrapping_mul(round) })
        .collect()
}

/// Cycles until `good`, or for too long.
async fn cycle_until(
    dispatcher: &Dispatcher<'_>,
    group: &Group<Op>,
    mut good: impl FnMut(&[u8]) -> bool,
) -> bool {
    let begin = Instant::now();
    while begin.elapsed() < SEEN_LIMIT {
        let counter = group.tx_rx(dispatcher.master).await.unwrap().working_counter;
        assert_eq!(counter, 3, "outputs are taken and inputs are there");
        if good(&group.subdevice(dispatcher.master, 0).unwrap().inputs_raw()) {
            return true;
        }
        Timer::after_millis(CYCLE_MS).await;
    }
    false
}

/// A board that has just found its controller sets it up while the MainDevice may have begun, which then begins anew.
async fn to_pre_op(dispatcher: &Dispatcher<'_>) -> Group<PreOp> {
    let begin = Instant::now();
    loop {
        match dispatcher.to_pre_op().await {
            Ok(group) => return group,
            Err(error) => assert!(begin.elapsed() < START_LIMIT, "{error}"),
        }
        Timer::after_millis(200).await;
    }
}

/// Configures the devices, and brings the board to Op.
async fn start(dispatcher: &Dispatcher<'_>) -> Group<Op> {
    let group = to_pre_op(dispatcher).await;
    let board = group.subdevice(dispatcher.master, 0).unwrap();
    board.register_write(WATCHDOG.0, WATCHDOG.1).await.unwrap();
    board.sdo_write(0x2000, 1, DEVICES.len() as u16).await.unwrap();
    for ((_, settings), index) in DEVICES.iter().zip(0x2001..) {
        for (value, sub) in settings.iter().zip(1..) {
            board.sdo_write(index, sub, *value).await.unwrap();
        }
        board.sdo_write(index, 10, 20_u32).await.unwrap();
    }
    board.sdo_write(0x2005, 1, 1_u16).await.unwrap();
    assert_eq!(board.sdo_read::<u16>(0x2005, 2).await.unwrap(), 1, "it is in use");
    let end = board.sdo_read::<u16>(0x2012, 6).await.unwrap();
    assert_eq!(usize::from(end), INPUT_BYTES - 1, "the last input byte of the last device");
    let group = group.into_safe_op(dispatcher.master).await.unwrap();
    group.tx_rx(dispatcher.master).await.unwrap();
    let group = group.request_into_op(dispatcher.master).await.unwrap();
    while !group.tx_rx(dispatcher.master).await.unwrap().all_op() {
        Timer::after_millis(CYCLE_MS).await;
    }
    group
}

#[test]
fn ethercrab_brings_the_board_to_op_and_values_pass_both_ways() {
    let (bench, controller, mut console) = with_controller();
    shows(&mut console, "show version", "EtherCAT controller present");
    shows(&mut console, "show ports", "ecat            ethercat");

    let (count, listed) = controller.run(async |dispatcher| {
        let group = to_pre_op(&dispatcher).await;
        let board = group.subdevice(dispatcher.master, 0).unwrap();
        let name = board.sdo_read::<[u8; 34]>(0x1008, 0).await.unwrap();
        assert_eq!(name, DEVICE.name.as_bytes());
        let counts = board.sdo_info_object_quantities().await.unwrap().unwrap();
        let objects = board.sdo_info_object_description_list(ObjectDescriptionListQuery::All).await;
        (usize::from(counts.all), objects.unwrap().unwrap().to_vec())
    });
    let objects: Vec<u16> = DEVICE.objects.iter().map(|object| object.index).collect();
    assert_eq!(count, objects.len(), "objects of the dictionary");
    // ethercrab 0.7 leaves out the last object of each fragment of the list but the first.
    let fragments = (2 * count).div_ceil(MAILBOX_BYTES - LIST_HEAD_BYTES);
    assert!(listed.len() + fragments > count, "{listed:x?}");
    assert!(listed.iter().is_sorted() && listed.iter().all(|index| objects.contains(index)), "{listed:x?}");

    let buses = bench.buses.clone();
    controller.run(async move |dispatcher| {
        let group = start(&dispatcher).await;
        for round in 1..=10 {
            let outputs = outputs(round);
            let board = group.subdevice(dispatcher.master, 0).unwrap();
            board.outputs_raw_mut()[..OUTPUT_BYTES].copy_from_slice(&outputs);
            buses[0].with(1, |memory| memory.input[10] = u16::from(round) << 8);
            buses[1].with(65, |memory| memory.input[7] = !u16::from(round));
            let arrived = cycle_until(&dispatcher, &group, |_| written(&buses) == outputs).await;
            assert!(arrived, "outputs {round}");
            let seen = |inputs: &[u8]| inputs[..INPUT_BYTES] == expected_inputs(&buses);
            assert!(cycle_until(&dispatcher, &group, seen).await, "inputs {round}");
        }
    });
    assert_eq!(written(&bench.buses), outputs(10));
    // TCP clients are served as ever.
    assert_eq!(bench.machine.client().read(129, 0, 2), registers(129, 0, 2));
}

#[test]
fn a_controller_that_goes_is_missed_and_works_when_it_is_back() {
    let (bench, controller, mut console) = with_controller();
    shows(&mut console, "show version", "EtherCAT controller present");
    drop(controller);
    shows(&mut console, "show version", "EtherCAT controller lost");
    shows(&mut console, "show ports", "lost, is opened again");
    shows(&mut console, "show log", "EtherCAT: the bus to the EtherCAT controller failed");
    assert_eq!(bench.machine.client().read(1, 0, 2), registers(1, 0, 2));

    let controller = Controller::start(bench.folder.path());
    shows(&mut console, "show version", "EtherCAT controller present");
    controller.run(async |dispatcher| drop(start(&dispatcher).await));
}

/// The board's LEDs: bit 0 is the RUN light, bit 1 the ERR light.
const LEDS: u32 = 0x4002_8000;

#[test]
fn the_boards_leds_are_the_run_and_err_lights() {
    let (bench, controller, mut console) = with_controller();
    shows(&mut console, "show version", "EtherCAT controller present");
    let leds = || bench.machine.register(LEDS) & 3;
    wait_for("both dark in Init", || (leds() == 0).then_some(()));
    // In Op RUN is on for longer than in any other state. Without outputs Op lasts until the watchdog runs out.
    wait_for("RUN to stay on", || {
        controller.run(async |dispatcher| drop(start(&dispatcher).await));
        wait_for("RUN to be on", || (leds() == 1).then_some(()));
        let since = Instant::now();
        while leds() == 1 {
            if since.elapsed() > Duration::from_millis(1_500) {
                return Some(());
            }
        }
        None
    });
    drop(controller);
    wait_for("ERR alone, without a controller", || (leds() == 2).then_some(()));
}

#[test]
fn without_a_controller_the_board_says_so_and_works() {
    let bench = Bench::new();
    let mut console = bench.machine.console();
    assert_eq!(console.run("port ecat ethercat line P1"), "");
    shows(&mut console, "show version", "EtherCAT controller missing");
    shows(&mut console, "show ports", "not found (no EtherCAT controller responds)");
    shows(
        &mut console,
        "show log",
        "no EtherCAT controller responds: 0xffffffff read instead of its test pattern",
    );
    assert_eq!(bench.machine.client().read(1, 0, 2), registers(1, 0, 2));
}
