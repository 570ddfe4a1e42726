//! The LAN9252 driver at a chip that works: what is read and written, what it costs, and that the chip is never misused.

use ethercat_subdevice::esc::{EscError, read_agreed};
use ethercat_subdevice::lan9252::Lan9252 as Driver;
use mobgate_simulator::lan9252::Traffic;

use crate::lan9252_bench::{with_driver, with_started};
use crate::prelude::*;
use mobgate_simulator::esc::samples::{INPUTS, OUT_BOX, OUTPUTS};

const USER: u16 = 0x0F80;
/// Memory behind all SyncManagers.
const FREE: u16 = 0x1800;

#[test]
fn registers_of_any_place_and_length_are_read_and_written() {
    with_driver(Timing::USUAL, async |driver, bench| {
        for (offset, length) in (0..4).flat_map(|offset| (0..10).map(move |length| (offset, length))) {
            let bytes: Vec<u8> = (1..=length).map(|byte| byte << 4 | offset as u8).collect();
            driver.write(USER + offset, &bytes).await.unwrap();
            let mut back = vec![0; usize::from(length)];
            driver.read(USER + offset, &mut back).await.unwrap();
            assert_eq!(back, bytes);
            assert_eq!(bench.peek::<16>(USER)[usize::from(offset)..][..bytes.len()], bytes);
        }
    });
}

#[test]
fn memory_of_any_place_and_length_is_read_and_written() {
    with_driver(Timing::USUAL, async |driver, bench| {
        for length in [1, 2, 3, 4, 5, 63, 64, 65, 120, 128, 513] {
            for offset in 0..4 {
                let bytes: Vec<u8> = (0..length).map(|nth: u16| (nth * 7 + offset) as u8).collect();
                driver.write(FREE + offset, &bytes).await.unwrap();
                let mut back = vec![0; usize::from(length)];
                driver.read(FREE + offset, &mut back).await.unwrap();
                assert_eq!(back, bytes);
                assert_eq!(bench.peek::<600>(FREE)[usize::from(offset)..][..bytes.len()], bytes);
            }
        }
    });
}

#[test]
fn neighbours_of_what_is_written_keep_their_values() {
    with_driver(Timing::USUAL, async |driver, bench| {
        driver.write(FREE, &[0xEE; 12]).await.unwrap();
        driver.write(FREE + 3, &[1, 2, 3, 4, 5, 6]).await.unwrap();
        assert_eq!(bench.peek::<12>(FREE), [0xEE, 0xEE, 0xEE, 1, 2, 3, 4, 5, 6, 0xEE, 0xEE, 0xEE]);
    });
}

#[test]
fn a_cycle_of_120_bytes_each_way_keeps_its_budget() {
    with_started(Timing::USUAL, async |driver, bench| {
        for cycle in 0..100 {
            bench.segment.borrow_mut().send_logical(Command::Lwr, 0, &[cycle; 120]);
            bench.chip.take_traffic();
            let mut outputs = [0; 120];
            driver.read(OUTPUTS, &mut outputs).await.unwrap();
            driver.write(INPUTS, &outputs).await.unwrap();
            assert_eq!(bench.chip.take_traffic(), Traffic { bytes: 290, selects: 6 });
            assert_eq!(outputs, [cycle; 120]);
            driver.events().await.unwrap();
        }
        bench.chip.take_traffic();
        driver.events().await.unwrap();
        assert_eq!(bench.chip.take_traffic(), Traffic { bytes: 25, selects: 3 });
    });
}

#[test]
fn fast_reads_have_their_byte_of_pause() {
    let timing = Timing { spi_hz: 60_000_000, ..Timing::USUAL };
    with_driver(timing, async |_, bench| {
        let mut driver = Driver::new(bench.chip.spi(), Wiring { spi_hz: 60_000_000, ..Wiring::default() });
        driver.write(FREE + 1, &[5; 50]).await.unwrap();
        let mut back = [0; 50];
        driver.read(FREE + 1, &mut back).await.unwrap();
        assert_eq!(back, [5; 50]);
    });
}

#[test]
fn a_mailbox_is_emptied_by_its_last_byte_and_filled_by_it() {
    with_started(Timing::USUAL, async |driver, bench| {
        assert_eq!(bench.segment.borrow_mut().poke(0, OUT_BOX, &[3; 128]), 1);
        assert_eq!(driver.events().await.unwrap() & 0x100, 0x100);
        let mut message = [0; 128];
        driver.read(OUT_BOX, &mut message).await.unwrap();
        assert_eq!(message, [3; 128]);
        assert_eq!(driver.events().await.unwrap() & 0x100, 0);
        assert_eq!(bench.segment.borrow_mut().poke(0, OUT_BOX, &[4; 128]), 1);
    });
}

#[test]
fn the_interrupt_pin_asks_for_the_processor_at_either_level() {
    for interrupt in [InterruptPin::High, InterruptPin::Low, InterruptPin::OpenDrain] {
        with_driver(Timing::USUAL, async |_, bench| {
            let mut driver = Driver::new(bench.chip.spi(), Wiring { interrupt, ..Wiring::default() });
            let chip = bench.chip.clone();
            let chip = if interrupt == InterruptPin::High { chip } else { chip.pulled_up() };
            let mut pin = chip.interrupt();
            driver.write(0x0204, &[1, 0, 0, 0]).await.unwrap();
            let asked = async {
                match interrupt {
                    InterruptPin::High => pin.wait_for_high().await.unwrap(),
                    InterruptPin::Low | InterruptPin::OpenDrain => pin.wait_for_low().await.unwrap(),
                }
                Instant::now()
            };
            let sent = Instant::now() + embassy_time::Duration::from_millis(3);
            let send = async {
                Timer::at(sent).await;
                bench.segment.borrow_mut().poke(0, 0x0120, &[2, 0]);
                std::future::pending::<()>().await;
            };
            let Either::First(at) = select(asked, send).await else { unreachable!("it never ends") };
            assert_eq!(at, sent);
        });
    }
}

#[test]
fn statement_42_images_are_whole_through_the_spi_too() {
    with_started(Timing::USUAL, async |driver, bench| {
        let image = |number: u32| number.to_le_bytes().repeat(30);
        bench.segment.borrow_mut().send_logical(Command::Lwr, 0, &image(0));
        let exchange = async {
            for number in 0..300 {
                let mut outputs = [0; 120];
                driver.read(OUTPUTS, &mut outputs).await.unwrap();
                assert!(outputs.chunks(4).all(|part| part == &outputs[..4]), "one image");
                driver.write(INPUTS, &image(number)).await.unwrap();
            }
        };
        let frames = async {
            for number in 0.. {
                let response =
                    bench.segment.borrow_mut().send_logical(Command::Lrw, 0, &image(number).repeat(2));
                let inputs = &response.data[120..];
                assert!(inputs.chunks(4).all(|part| part == &inputs[..4]), "one image");
                Timer::after_micros(7 + u64::from(number) % 13).await;
            }
        };
        let Either::First(()) = select(exchange, frames).await else { unreachable!("frames never end") };
    });
}

#[test]
fn an_access_that_is_given_up_in_the_middle_does_not_disturb_the_next() {
    with_driver(Timing::USUAL, async |driver, bench| {
        driver.write(FREE, &[9; 200]).await.unwrap();
        for micros in (0..120).step_by(3) {
            let mut lost = [0; 200];
            select(driver.read(FREE, &mut lost), Timer::after_micros(micros)).await;
            let mut back = [0; 200];
            driver.read(FREE, &mut back).await.unwrap();
            assert_eq!(back, [9; 200]);
            select(driver.write(FREE, &[8; 200]), Timer::after_micros(micros)).await;
            driver.write(FREE, &[9; 200]).await.unwrap();
            assert_eq!(bench.peek(FREE), [9; 200]);
            select(driver.read(USER, &mut [0; 8]), Timer::after_micros(micros)).await;
            assert_eq!(driver.events().await.unwrap() & 1, 0);
        }
    });
}

#[test]
fn images_that_were_read_twice_agree() {
    with_started(Timing::USUAL, async |driver, bench| {
        bench.segment.borrow_mut().send_logical(Command::Lwr, 0, &[6; 120]);
        let mut outputs = [0; 120];
        read_agreed(driver, OUTPUTS, &mut outputs).await.unwrap();
        assert_eq!(outputs, [6; 120]);
        // Images that change faster than they can be read twice never agree.
        let mut fast = async |driver: &mut Driver<_>| {
            let frames = async {
                for number in 0.. {
                    bench.segment.borrow_mut().send_logical(Command::Lwr, 0, &[number as u8; 120]);
                    Timer::after_micros(10).await;
                }
            };
            match select(read_agreed(driver, OUTPUTS, &mut outputs), frames).await {
                Either::First(outcome) => outcome,
                Either::Second(()) => unreachable!("frames never end"),
            }
        };
        assert_eq!(fast(driver).await, Err(EscError::Garbled(OUTPUTS)));
    });
}
