//! Events through the whole path, frame to interrupt pin to driver: none is missed, whatever the pace.

use ethercat_subdevice::lan9252::Lan9252 as Driver;
use mobgate_simulator::esc::Interrupt;
use mobgate_simulator::lan9252::Spi;

use crate::lan9252_bench::{Bench, with_started};
use crate::prelude::*;
use mobgate_simulator::esc::samples::{IN_BOX, INPUTS, OUT_BOX, OUTPUTS};

const MAILBOX: u32 = 1 << 8;
const NEW_OUTPUTS: u32 = 1 << 10;
/// Full, in a SyncManager's status.
const FULL: u8 = 1 << 3;
/// After so many cycles without a response the mailbox counts as lost.
const PATIENCE: u32 = 200;

/// Answers every message with itself and shows the outputs as inputs, whenever the interrupt pin asks for it.
async fn firmware(driver: &mut Driver<Spi>, mut pin: Interrupt, seen: &RefCell<Vec<u8>>) {
    driver.write(0x0204, &(MAILBOX | NEW_OUTPUTS).to_le_bytes()).await.unwrap();
    loop {
        pin.wait_for_high().await.unwrap();
        let events = driver.events().await.unwrap();
        if events & NEW_OUTPUTS != 0 {
            let mut image = [0; 120];
            driver.read(OUTPUTS, &mut image).await.unwrap();
            driver.write(INPUTS, &image).await.unwrap();
        }
        if events & MAILBOX != 0 {
            let mut message = [0; 128];
            driver.read(OUT_BOX, &mut message).await.unwrap();
            seen.borrow_mut().push(message[0]);
            driver.write(IN_BOX, &message).await.unwrap();
        }
    }
}

/// Sends outputs every `cycle` and a message as soon as the last one was answered, now and then a burst without a pause.
async fn main_device(bench: &Bench, cycle: Duration, cycles: u32, random: &mut Random) -> u8 {
    let (mut sent, mut waited) = (0_u8, 0);
    for number in 0..cycles {
        {
            let segment = &mut bench.segment.borrow_mut();
            segment.send_logical(Command::Lwr, 0, &[number as u8; 120]);
            if segment.fetch(0, 0x080D, 1).unwrap()[0] & FULL != 0 {
                let response = segment.fetch(0, IN_BOX, 128);
                assert_eq!(response, Some(vec![sent; 128]), "the response to the last message");
                waited = 0;
            }
            if waited == 0 {
                sent = sent.wrapping_add(1);
                assert_eq!(segment.poke(0, OUT_BOX, &[sent; 128]), 1);
            }
        }
        waited += 1;
        assert!(waited < PATIENCE, "message {sent} was lost");
        if !random.chance(0.1) {
            Timer::after(cycle).await;
        }
    }
    // The last outputs must come through without any further frame.
    Timer::after_millis(2).await;
    let inputs = bench.segment.borrow_mut().send_logical(Command::Lrd, 120, &[0; 120]);
    assert_eq!((inputs.counter, inputs.data), (1, vec![(cycles - 1) as u8; 120]));
    sent
}

#[test]
fn statement_45_no_event_and_no_mailbox_is_lost_at_any_cycle_time() {
    for (micros, seed) in [(100, 1), (250, 2), (1_000, 3), (4_000, 4)] {
        with_started(Timing::USUAL, async |driver, bench| {
            let seen = RefCell::default();
            let pin = bench.chip.interrupt();
            let mut random = Random::new(seed);
            let master = main_device(bench, Duration::from_micros(micros), 1_000, &mut random);
            let Either::Second(sent) = select(firmware(driver, pin, &seen), master).await else {
                unreachable!("the firmware never ends")
            };
            let seen = seen.into_inner();
            assert_eq!((seen.first(), seen.last()), (Some(&1), Some(&sent)));
            let in_order = seen.windows(2).all(|pair| pair[1] == pair[0].wrapping_add(1));
            assert!(in_order, "each message once, in order");
        });
    }
}
