//! What a save leaves to other tasks while it looks through the flash.

use std::cell::Cell;
use std::future::poll_fn;
use std::pin::pin;
use std::rc::Rc;

use embassy_futures::block_on;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use mobgate::hal::Store;
use mobgate_clock as _;
use mobgate_flash::{FlashStore, Image};
use mobgate_simulator::flash::SimFlash;
use mobgate_simulator::power_cuts::{save, text};

type Chip = SimFlash<32, { 128 * 1024 }>;

/// A flash that counts the bytes that are read, and the sectors that are erased.
#[derive(Clone)]
struct Counted {
    chip: Chip,
    read: Rc<Cell<usize>>,
    erased: Rc<Cell<usize>>,
}

impl ErrorType for Counted {
    type Error = <Chip as ErrorType>::Error;
}

impl ReadNorFlash for Counted {
    const READ_SIZE: usize = Chip::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Self::Error> {
        self.read.update(|read| read + bytes.len());
        self.chip.read(offset, bytes).await
    }

    fn capacity(&self) -> usize {
        self.chip.capacity()
    }
}

impl NorFlash for Counted {
    const WRITE_SIZE: usize = Chip::WRITE_SIZE;
    const ERASE_SIZE: usize = Chip::ERASE_SIZE;

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        self.chip.write(offset, bytes).await
    }

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Self::Error> {
        self.erased.update(|erased| erased + 1);
        self.chip.erase(from, to).await
    }
}

/// The first full sector after a start is the longest work: each item is looked for through all of them.
#[test]
fn other_tasks_run_between_two_items() {
    let (chip, read, erased) = (Chip::new(2, 3), Rc::default(), Rc::default());
    let flash = Counted { chip, read, erased };
    let open = || block_on(FlashStore::open(flash.clone(), 0, Image::ONLY));
    let mut store = open();
    (0..30).for_each(|seed| save(&mut store, &text(10_000, seed)).unwrap());
    let mut has_moved = false;
    for seed in 30..40 {
        let mut store = open();
        let (erased, all) = (flash.erased.get(), flash.read.get());
        let text = text(10_000, seed);
        let mut saving = pin!(async {
            store.append(&text).await?;
            store.commit().await
        });
        let mut most = 0;
        block_on(poll_fn(|context| {
            let before = flash.read.get();
            let polled = saving.as_mut().poll(context);
            most = most.max(flash.read.get() - before);
            polled
        }))
        .unwrap();
        assert!(most < 8 * 1024, "{most} bytes at a time");
        has_moved |= flash.erased.get() > erased && flash.read.get() > all + 100 * 1024;
    }
    assert!(has_moved, "a sector was full");
}
