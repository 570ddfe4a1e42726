//! EtherCAT, with a LAN9252 at the board's SPI.

use std::time::Duration;

use embassy_time::Timer;
use mobgate_stm32_emulator::{Board, Controller, Dispatcher, Family, Machine};

use crate::clients::respond;
use crate::drive::Drive;
use crate::figure::{Target, figure};
use crate::firmware::START_MAX;
use crate::update_file::{hanging, signed};
use crate::{on_each_board, set_up, wait_for_prompt, ymodem};

on_each_board!(
    a_main_device_brings_the_board_to_op_and_sees_a_device,
    ethercrab_brings_the_board_to_op_and_values_pass_both_ways,
    new_firmware_comes_by_foe_in_boot,
    a_controller_that_was_reset_comes_to_op_again,
    a_cycle_takes_the_processor_no_longer_than_is_promised,
);

/// Process data cycles that are counted, and how far they are apart.
const CYCLES: u32 = 100;
const CYCLE: Duration = Duration::from_millis(1);
/// Bytes of a cycle with 120 of outputs and of inputs that DMA does not transfer, and its chip selects.
const DIRECT_BYTES: f64 = 76.0;
const SELECTS: f64 = 8.0;
/// What 1C32h:05 promises of a cycle besides bus and chip selects.
const FIXED_US: f64 = 25.0;
/// What is promised over instructions at one a clock: the flash has wait states.
const MARGIN: f64 = 1.25;

/// A board that has found the controller, with a device on its first line of which an input register is read.
fn with_controller(board: Board) -> (Machine, Controller) {
    let mut machine = Machine::new(board).unwrap();
    let mut controller = Controller::connect(&machine);
    controller.run(&mut machine, Duration::from_secs(5)).unwrap();
    wait_for_prompt(&mut machine);
    set_up(
        &mut machine,
        &[
            "port P1 serial uart1 rtu client 115200 8E1",
            "port ecat ethercat line P1",
            "route ecat 1-64 * * P1",
            "slave 0 unit 5 input 66 count 1 read 100ms",
        ],
    );
    (machine, controller)
}

fn shows_op(machine: &mut Machine) {
    let version = machine.type_line("show version").unwrap();
    assert!(version.contains("EtherCAT controller present, Op, RUN on, ERR off"), "{version}");
}

fn a_main_device_brings_the_board_to_op_and_sees_a_device(board: Board) {
    let (mut machine, mut controller) = with_controller(board);
    controller.bring_to_op(&mut machine).unwrap();
    shows_op(&mut machine);
    let mut asked = Vec::new();
    let end = machine.now() + Duration::from_secs(5);
    loop {
        let inputs = controller.exchange(&mut machine, vec![]).unwrap();
        // The register's value is its address, and the unit.
        if inputs[..2] == [66, 5] {
            break;
        }
        assert!(machine.now() < end, "{inputs:?}");
        for _ in 0..100 {
            controller.run(&mut machine, Duration::from_micros(200)).unwrap();
            respond(&mut machine, &mut asked);
        }
    }
    assert_eq!(controller.violations(), [""; 0]);
}

fn ethercrab_brings_the_board_to_op_and_values_pass_both_ways(board: Board) {
    const NAME: &[u8; 34] = b"mobgate EtherCAT to Modbus gateway";
    /// Values that go to the drive and come back.
    const VALUES: [u16; 5] = [1, 0x1234, 0x8000, 0xffff, 7];
    /// An output is written and read back long before.
    const CYCLES_MAX: usize = 1_000;
    let (mut machine, mut controller) = with_controller(board);
    let (mut drive, is) = Drive::new();
    let script = async move |main_device: Dispatcher<'_>| {
        let group = main_device.to_pre_op().await.unwrap();
        let gateway = group.subdevice(main_device.master, 0).unwrap();
        assert_eq!(gateway.sdo_read::<[u8; 34]>(0x1008, 0).await.unwrap(), *NAME);
        assert_eq!(gateway.sdo_read::<u32>(0x1018, 1).await.unwrap(), gateway.identity().vendor_id);
        gateway.sdo_write(0x2000, 1, 1_u16).await.unwrap();
        // Unit; count and first of coils, discrete inputs, input and holding registers.
        for (value, sub) in
            [Drive::UNIT.into(), 0, 0, 0, 0, 1, Drive::INVERSE, 1, Drive::VALUE].iter().zip(1..)
        {
            gateway.sdo_write::<u16>(0x2001, sub, *value).await.unwrap();
        }
        gateway.sdo_write(0x2001, 10, 20_u32).await.unwrap();
        gateway.sdo_write(0x2005, 1, 1_u16).await.unwrap();
        assert_eq!(gateway.sdo_read::<u16>(0x2005, 2).await.unwrap(), 1, "it is in use");
        let group = main_device.to_op(group, 0).await.unwrap();
        for value in VALUES {
            let gateway = group.subdevice(main_device.master, 0).unwrap();
            gateway.outputs_raw_mut()[..2].copy_from_slice(&value.to_be_bytes());
            let expected = [(!value).to_be_bytes(), value.to_be_bytes()].concat();
            let mut cycles = 0;
            while gateway.inputs_raw()[..4] != expected {
                assert_eq!(group.tx_rx(main_device.master).await.unwrap().working_counter, 3);
                cycles += 1;
                assert!(cycles < CYCLES_MAX, "{value:#x} does not come back");
                Timer::after_millis(1).await;
            }
            assert_eq!(is.get(), value);
        }
    };
    controller.with_ethercrab(&mut machine, script, |machine| drive.step(machine)).unwrap();
    shows_op(&mut machine);
    assert_eq!(controller.violations(), [""; 0]);
}

fn a_controller_that_was_reset_comes_to_op_again(board: Board) {
    let (mut machine, mut controller) = with_controller(board);
    controller.bring_to_op(&mut machine).unwrap();
    controller.reset();
    controller.run(&mut machine, Duration::from_secs(2)).unwrap();
    // The error that tells of the restart stands until the first try has acknowledged it.
    let _ = controller.bring_to_op(&mut machine);
    controller.bring_to_op(&mut machine).unwrap();
    shows_op(&mut machine);
}

fn a_cycle_takes_the_processor_no_longer_than_is_promised(board: Board) {
    let (mut machine, mut controller) = with_controller(board);
    controller.bring_to_op(&mut machine).unwrap();
    let mut measure = |exchanges: bool| {
        let (before, end) = (machine.instructions(), machine.now() + CYCLE * CYCLES);
        for nth in 1..=CYCLES {
            if exchanges {
                // Outputs that differ from the last ones, and belong to no device.
                controller.exchange(&mut machine, vec![0, 0, nth as u8]).unwrap();
            }
            let rest = end - CYCLE * (CYCLES - nth) - machine.now();
            controller.run(&mut machine, rest).unwrap();
        }
        (machine.instructions() - before) / u64::from(CYCLES)
    };
    // What runs anyway does not count.
    let idle = measure(false);
    let instructions = (measure(true) - idle) as f64;
    let (megahertz, spi_megahertz, select_us) = match board.family {
        Family::F4 => (168.0, 21.0, 17.0),
        Family::F7 => (216.0, 27.0, 12.0),
        Family::H7 => (400.0, 25.0, 6.0),
    };
    // The processor waits for these bytes.
    let micros = instructions / megahertz - DIRECT_BYTES * 8.0 / spi_megahertz;
    let name = board.name.trim_start_matches("nucleo_");
    figure(&format!("{name}_ethercat_cycle_instructions"), instructions, "instructions", Target::None);
    let promised = (SELECTS * select_us + FIXED_US) / MARGIN;
    figure(&format!("{name}_ethercat_cycle_processor_us"), micros, "us", Target::AtMost(promised));
}

fn new_firmware_comes_by_foe_in_boot(board: Board) {
    let (mut machine, mut controller) = with_controller(board);
    let program = machine.program();
    let file = |minor, patch| signed(&hanging(&program, minor, patch));
    let write = |controller: &mut Controller, machine: &mut Machine, file| {
        controller.write_file(machine, "firmware.mgu", file).unwrap()
    };
    let refused = write(&mut controller, &mut machine, file(0, 9));
    assert_eq!(refused, Some((0x8002, "the image is older than what runs".to_owned())));
    assert_eq!(write(&mut controller, &mut machine, file(1, 1)), None);
    let shows = |machine: &mut Machine, text: &str| {
        let update = machine.type_line("show update").unwrap();
        assert!(update.contains(text), "{update}");
    };
    shows(&mut machine, "0.1.0: confirmed, 0.1.1 starts with the next restart");
    // What begins at the console overwrites it: nothing else starts when Boot is left.
    let refused = ymodem::send(&mut machine, "update", b"no image", |_| ());
    assert!(refused.contains("error: this is no image of mobgate"), "{refused}");
    shows(&mut machine, "0.1.0: confirmed\r\n");
    controller.leave_boot(&mut machine).unwrap();
    machine.wait_for_prompt(START_MAX).unwrap();
    shows(&mut machine, "0.1.0: confirmed\r\n");
    controller.run(&mut machine, Duration::from_secs(2)).unwrap();
    machine.resets.clear();
    assert_eq!(write(&mut controller, &mut machine, file(1, 1)), None);
    controller.leave_boot(&mut machine).unwrap();
    assert_eq!(machine.resets, [], "the MainDevice must see that Boot was left");
    machine.wait_for_prompt(START_MAX).unwrap();
    // What came hangs.
    shows(&mut machine, "0.1.0: went back from 0.1.1: started by the watchdog while on trial");
}
