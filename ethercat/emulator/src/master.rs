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
/// Frames that synchronise clocks at start-up; few, as a single device has nothing to synchronise.
const CLOCK_FRAMES: u32 = 10;

/// Frame storage of a MainDevice.
pub type Storage = PduStorage<FRAMES, { PduStorage::element_size(DATA_BYTES) }>;

/// A frame not returned by then is lost; shorter than the default, so that an EEPROM read survives a few losses.
const FRAME_TIMEOUT: Duration = Duration::from_millis(3);
const EEPROM_TIMEOUT: Duration = Duration::from_millis(100);
/// For the wall clock.
const PATIENCE: Duration = Duration::from_secs(15);
const POLL_INTERVAL: Duration = Duration::from_millis(1);

/// A MainDevice that retries up to `retries` times without a response.
pub fn main_device(pdu_loop: PduLoop<'_>, retries: usize) -> MainDevice<'_> {
    let config = MainDeviceConfig {
        dc_static_sync_iterations: CLOCK_FRAMES,
        retry_behaviour: RetryBehaviour::Count(retries),
    };
    let timeouts = Timeouts { pdu: FRAME_TIMEOUT, eeprom: EEPROM_TIMEOUT, ..Timeouts::default() };
    MainDevice::new(pdu_loop, timeouts, config)
}

/// A MainDevice on the wall clock, with timeouts that suit a busy host.
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

/// Carries a MainDevice's frames over `cable` forever.
pub async fn pump(mut tx: PduTx<'_>, mut rx: PduRx<'_>, mut cable: Cable) -> Infallible {
    loop {
        for response in cable.carry(next_frame(&mut tx).await).await {
            // Frames that return twice or late have no receiver: an error is the master's correct reaction.
            let _ = rx.receive_frame(&response);
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
