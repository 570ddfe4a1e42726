//! What a save leaves to other tasks while it looks through the flash.

use std::future::poll_fn;
use std::pin::pin;

use embassy_futures::block_on;
use mobgate::hal::Store;
use mobgate_clock as _;
use mobgate_flash::{FlashStore, Image};
use mobgate_simulator::flash::SimFlash;
use mobgate_simulator::power_cuts::{save, text};

type Flash = SimFlash<32, { 128 * 1024 }>;

/// The first full sector after a start is the longest work: each item is looked for through all of them.
#[test]
fn other_tasks_run_between_two_items() {
    let flash = Flash::new(2, 3);
    let open = || block_on(FlashStore::open(flash.clone(), 0, Image::ONLY));
    let mut store = open();
    (0..30).for_each(|seed| save(&mut store, &text(10_000, seed)).unwrap());
    let mut has_moved = false;
    for seed in 30..40 {
        let mut store = open();
        let (erased, all) = (flash.sectors_erased(), flash.bytes_read());
        let text = text(10_000, seed);
        let mut saving = pin!(async {
            store.append(&text).await?;
            store.commit().await
        });
        let mut most = 0;
        block_on(poll_fn(|context| {
            let before = flash.bytes_read();
            let polled = saving.as_mut().poll(context);
            most = most.max(flash.bytes_read() - before);
            polled
        }))
        .unwrap();
        assert!(most < 8 * 1024, "{most} bytes at a time");
        has_moved |= flash.sectors_erased() > erased && flash.bytes_read() > all + 100 * 1024;
    }
    assert!(has_moved, "a sector was full");
}
