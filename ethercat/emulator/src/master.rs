//! ethercrab as the MainDevice, in process and in virtual time.

use std::convert::Infallible;
use std::future::poll_fn;
use std::task::Poll;
use std::time::Duration;

use ethercrab::{MainDevice, MainDeviceConfig, PduLoop, PduRx, PduStorage, PduTx, RetryBehaviour, Timeouts};

use super::cable::Cable;

const FRAMES: usize = 16;
/// Bytes of data in a frame.
pub const DATA_BYTES: usize = 1100;
/// A start-up synchronises clocks with so many frames; a single device has nothing to synchronise.
const CLOCK_FRAMES: u32 = 10;

/// Memory for a MainDevice's frames.
pub type Storage = PduStorage<FRAMES, { PduStorage::element_size(DATA_BYTES) }>;

/// A frame that is not back by then is lost; lower than usual, so that an EEPROM read outlives some lost ones.
const FRAME_TIMEOUT: Duration = Duration::from_millis(3);
const EEPROM_TIMEOUT: Duration = Duration::from_millis(100);
/// On the wall clock.
const PATIENCE: Duration = Duration::from_secs(15);
const POLL_INTERVAL: Duration = Duration::from_millis(1);

/// A MainDevice that asks again up to `retries` times when no answer comes.
pub fn main_device(pdu_loop: PduLoop<'_>, retries: usize) -> MainDevice<'_> {
    let config = MainDeviceConfig {
        dc_static_sync_iterations: CLOCK_FRAMES,
        retry_behaviour: RetryBehaviour::Count(retries),
    };
    let timeouts = Timeouts { pdu: FRAME_TIMEOUT, eeprom: EEPROM_TIMEOUT, ..Timeouts::default() };
    MainDevice::new(pdu_loop, timeouts, config)
}

/// A MainDevice on the wall clock, which waits as long as a busy host may let it wait.
pub fn patient_main_device(pdu_loop: PduLoop<'_>) -> MainDevice<'_> {
    let config = MainDeviceConfig { dc_static_sync_iterations: CLOCK_FRAMES, ..MainDeviceConfig::default() };
    let timeouts = Timeouts {
        state_transition: PATIENCE,
        pdu: PATIENCE,
        eeprom: PATIENCE,
        wait_loop_delay: POLL_INTERVAL,
        mailbox_echo: PATIENCE,
        mailbox_response: PATIENCE,
    };
    MainDevice::new(pdu_loop, timeouts, config)
}

/// Carries a MainDevice's frames over `cable`, for ever.
pub async fn pump(mut tx: PduTx<'_>, mut rx: PduRx<'_>, mut cable: Cable) -> Infallible {
    loop {
        for answer in cable.carry(next_frame(&mut tx).await).await {
            // What comes twice or too late nobody waits for any more: an error here is the master's right answer to it.
            let _ = rx.receive_frame(&answer);
        }
    }
}

async fn next_frame(tx: &mut PduTx<'_>) -> Vec<u8> {
    poll_fn(|context| {
        tx.replace_waker(context.waker());
        let Some(sendable) = tx.next_sendable_frame() else { return Poll::Pending };
        let mut frame = Vec::new();
        let sent = sendable.send_blocking(|bytes| {
            frame.extend(bytes);
            Ok(bytes.len())
        });
        sent.expect("memory takes every frame");
        Poll::Ready(frame)
    })
    .await
}
