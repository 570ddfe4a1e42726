//! The LAN9252 driver at a chip that does not work as it should: it reports, stays bounded, and comes back.

use ethercat_subdevice::esc::{EscError, read_agreed};
use ethercat_subdevice::lan9252::{Incidents, Lan9252 as Driver};
use mobgate_simulator::esc::now;
use mobgate_simulator::lan9252::{Spi, SpiFaults};

use crate::lan9252_bench::{Bench, with_driver, with_started};
use crate::prelude::*;
use mobgate_simulator::esc::samples::{INPUTS, OUTPUTS};

const USER: u16 = 0x0F80;
const FREE: u16 = 0x1800;
/// Longer than any single access may take, whatever the chip does.
const ACCESS_LIMIT: Duration = Duration::from_secs(2);

/// What the chip was told before is gone; told again, it carries outputs.
async fn starts_anew(driver: &mut Driver<Spi>, bench: &Bench) {
    bench.set_up();
    bench.segment.borrow_mut().send_logical(Command::Lwr, 0, &[5; 120]);
    let mut outputs = [0; 120];
    driver.read(OUTPUTS, &mut outputs).await.unwrap();
    assert_eq!(outputs, [5; 120]);
}

#[test]
fn statement_54_a_chip_that_shows_garbage_for_a_while_and_is_ready_late_is_waited_for() {
    let timing = Timing { test_nanos: 50_000_000, ready_nanos: 400_000_000, ..Timing::USUAL };
    with_driver(timing, async |driver, bench| {
        driver.write(USER, &[1, 2, 3]).await.unwrap();
        assert_eq!(bench.peek(USER), [1, 2, 3]);
        assert!(Instant::now() < Instant::from_secs(1));
    });
}

#[test]
fn statement_54_a_chip_that_never_responds_is_reported_in_bounded_time() {
    let timing = Timing { test_nanos: u64::MAX / 2, ready_nanos: u64::MAX / 2, ..Timing::USUAL };
    with_driver(timing, async |driver, _| {
        for _ in 0..3 {
            let begin = Instant::now();
            assert_eq!(driver.events().await, Err(EscError::Absent(u32::MAX)));
            assert!(begin.elapsed() < ACCESS_LIMIT);
        }
    });
}

#[test]
fn statement_54_a_chip_that_never_gets_ready_is_reported_in_bounded_time() {
    let timing = Timing { ready_nanos: u64::MAX / 2, ..Timing::USUAL };
    with_driver(timing, async |driver, _| {
        let begin = Instant::now();
        assert_eq!(driver.events().await, Err(EscError::Stuck(0x74)));
        assert!(begin.elapsed() < ACCESS_LIMIT);
    });
}

#[test]
fn statement_54_a_hanging_register_engine_costs_a_reset_that_is_reported() {
    with_driver(Timing::USUAL, async |driver, bench| {
        driver.write(USER, &[1]).await.unwrap();
        bench.chip.hang_registers();
        assert_eq!(driver.read(USER, &mut [0]).await, Err(EscError::Stuck(USER)));
        assert_eq!(driver.read(USER, &mut [0]).await, Err(EscError::Restarted));
        let mut state = [0; 6];
        driver.read(0x0130, &mut state).await.unwrap();
        assert_eq!(state, [1, 0, 0, 0, 0, 0], "the chip is in INIT");
        assert_eq!((driver.incidents().stuck, driver.incidents().restarts), (1, 1));
    });
}

#[test]
fn statement_54_a_hanging_transfer_costs_a_reset_when_an_abort_did_not_help() {
    with_driver(Timing::USUAL, async |driver, bench| {
        driver.write(FREE, &[7; 40]).await.unwrap();
        bench.chip.hang_transfers();
        assert_eq!(driver.read(FREE, &mut [0; 40]).await, Err(EscError::Stuck(FREE)));
        driver.read(USER, &mut [0]).await.expect("the registers still work");
        assert_eq!(driver.read(FREE, &mut [0; 40]).await, Err(EscError::Stuck(FREE)));
        assert_eq!(driver.read(FREE, &mut [0; 40]).await, Err(EscError::Restarted));
        bench.chip.forgive();
        driver.write(FREE, &[8; 40]).await.unwrap();
        assert_eq!(bench.peek(FREE), [8; 40]);
    });
}

#[test]
fn a_chip_that_was_reset_behind_the_drivers_back_is_noticed_and_set_up_again() {
    with_started(Timing::USUAL, async |driver, bench| {
        bench.chip.reset();
        Timer::after_millis(30).await;
        assert_eq!(driver.events().await, Err(EscError::Restarted));
        bench.chip.forgive();
        starts_anew(driver, bench).await;
    });
}

#[test]
fn a_reset_in_the_middle_of_an_access_never_gives_wrong_data() {
    for micros in (0..100).step_by(7) {
        with_started(Timing::USUAL, async |driver, bench| {
            bench.segment.borrow_mut().send_logical(Command::Lwr, 0, &[5; 120]);
            driver.read(OUTPUTS, &mut [0; 120]).await.unwrap();
            let mut outputs = [0; 120];
            let reset = async {
                Timer::after_micros(micros).await;
                bench.chip.reset();
            };
            let (outcome, ()) = embassy_futures::join::join(driver.read(OUTPUTS, &mut outputs), reset).await;
            assert!(outcome.is_err() || outputs == [5; 120], "reset after {micros} us");
            let mut outcome = Ok(0);
            for _ in 0..3 {
                outcome = driver.events().await;
                if outcome == Err(EscError::Restarted) {
                    break;
                }
                Timer::after_millis(25).await;
            }
            assert_eq!(outcome, Err(EscError::Restarted), "and it is always told");
        });
    }
}

#[test]
fn an_engine_slower_than_the_spi_is_watched_from_the_first_use_on() {
    for fifo_nanos in [1_700, 2_000, 4_000] {
        with_driver(Timing { fifo_nanos, ..Timing::USUAL }, async |driver, bench| {
            // The model takes every double word that did not fit for misuse; the driver tries that once, after a reset.
            bench.chip.reset();
            driver.events().await.unwrap();
            bench.chip.forgive();
            for byte in 1..20 {
                driver.write(FREE, &[byte; 300]).await.unwrap();
                let mut back = [0; 300];
                driver.read(FREE, &mut back).await.unwrap();
                assert_eq!(back, [byte; 300]);
            }
        });
    }
}

#[test]
fn a_failing_bus_is_reported_and_works_again_when_it_does() {
    with_driver(Timing::USUAL, async |driver, bench| {
        driver.write(USER, &[1]).await.unwrap();
        bench.chip.set_faults(SpiFaults { failed: 1.0, ..SpiFaults::default() }, Random::new(1));
        assert_eq!(driver.read(FREE, &mut [0; 9]).await, Err(EscError::Bus));
        bench.chip.set_faults(SpiFaults::default(), Random::new(1));
        bench.chip.forgive();
        let mut back = [0];
        driver.read(USER, &mut back).await.unwrap();
        assert_eq!(back, [1], "no reset was needed");
    });
}

#[test]
fn statement_55_bit_errors_never_make_a_wrong_output_image_when_it_is_read_twice() {
    for seed in 0..4 {
        with_started(Timing::USUAL, async |driver, bench| {
            let faults = SpiFaults { flipped: 1e-4, failed: 1e-4 };
            bench.chip.set_faults(faults, Random::new(seed));
            let mut good = 0;
            for cycle in 0..500_u16 {
                let sent: Vec<u8> = (0..120).map(|nth| (cycle * 31 + nth) as u8).collect();
                bench.segment.borrow_mut().send_logical(Command::Lwr, 0, &sent);
                let mut outputs = [0; 120];
                match read_agreed(driver, OUTPUTS, &mut outputs).await {
                    Ok(()) => {
                        assert_eq!(outputs, *sent, "cycle {cycle}");
                        good += 1;
                    }
                    Err(EscError::Restarted) => bench.set_up(),
                    Err(_) => {}
                }
                if driver.write(INPUTS, &outputs).await == Err(EscError::Restarted) {
                    bench.set_up();
                }
            }
            assert!(good > 400 && bench.chip.faults_injected() > 20, "{good} of 500");
            assert!(driver.incidents() != Incidents::default(), "they show in diagnosis");
            bench.chip.set_faults(SpiFaults::default(), Random::new(0));
            // What a corrupt access has left behind ends with the next.
            let _ = driver.events().await;
            bench.chip.forgive();
            starts_anew(driver, bench).await;
        });
    }
}

#[test]
fn statement_55_bit_errors_never_make_a_wrong_register_value() {
    with_started(Timing::USUAL, async |driver, bench| {
        bench.chip.set_faults(SpiFaults { flipped: 2e-3, failed: 0.0 }, Random::new(3));
        let mut good = 0;
        for _ in 0..5_000 {
            let mut identity = [0; 4];
            if driver.read(0x0000, &mut identity).await.is_ok() {
                assert_eq!(identity, [0xC0, 2, 0, 0]);
                good += 1;
            }
        }
        assert!(good > 4_000, "{good} of 5000");
        assert!(driver.incidents().repeated > 100);
    });
}

/// Something bad happens to the chip or its SPI.
fn misfortune(bench: &Bench, random: &mut Random) {
    match random.index(4) {
        0 => bench.chip.reset(),
        1 => bench.chip.hang_registers(),
        2 => bench.chip.hang_transfers(),
        _ => bench.chip.set_faults(SpiFaults { flipped: 1e-2, failed: 1e-2 }, random.fork()),
    }
}

/// Any access; how it ended.
async fn access(driver: &mut Driver<Spi>, random: &mut Random) -> Result<(), EscError> {
    let mut bytes = [0; 200];
    let length = 1 + random.index(bytes.len());
    let begin = Instant::now();
    let outcome = match random.index(5) {
        0 => driver.events().await.map(|_| ()),
        1 => driver.read(USER, &mut bytes[..length.min(16)]).await,
        2 => driver.write(USER, &bytes[..length.min(16)]).await,
        3 => driver.read(FREE, &mut bytes[..length]).await,
        _ => driver.write(FREE, &bytes[..length]).await,
    };
    assert!(begin.elapsed() < ACCESS_LIMIT, "{outcome:?} took {:?}", begin.elapsed());
    outcome
}

#[test]
fn statement_54_whatever_happens_every_access_ends_and_the_chip_comes_back() {
    const MARK: u16 = 0x0FF0;
    for seed in 0..20 {
        with_started(Timing::USUAL, async |driver, bench| {
            let mut random = Random::new(seed);
            for round in 0..10 {
                bench.segment.borrow().chip(0).borrow_mut().write(now(), MARK, &[0x77]);
                misfortune(bench, &mut random);
                let mut told = false;
                for _ in 0..20 {
                    told |= access(driver, &mut random).await == Err(EscError::Restarted);
                }
                bench.chip.set_faults(SpiFaults::default(), random.fork());
                // Long enough for the driver to look after the chip, often enough for it to see that an abort does not help.
                for _ in 0..30 {
                    Timer::after_millis(5).await;
                    told |= access(driver, &mut random).await == Err(EscError::Restarted);
                }
                let lost = bench.peek(MARK) != [0x77];
                assert!(told || !lost, "seed {seed}, round {round}: the caller must know what is gone");
                bench.chip.forgive();
                for _ in 0..20 {
                    access(driver, &mut random).await.unwrap();
                }
            }
        });
    }
}
