//! What a console and a start see of the store.

use embassy_futures::block_on;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embedded_storage_async::nor_flash::NorFlash;
use mobgate::config::{Settings, read_store, write_store};
use mobgate::hal::{Store, StoreError};
use mobgate_clock as _;
use mobgate_flash::{FlashStore, SharedStore, TEXT_BYTES_MAX, text_bytes_max};
use mobgate_simulator::flash::SimFlash;

/// As in an STM32H743: 32-byte words, sectors of 128 KiB.
type Flash = SimFlash<32, { 128 * 1024 }>;

fn read(store: &mut impl Store) -> Result<Vec<u8>, StoreError> {
    let (mut text, mut chunk) = (Vec::new(), [0; 100]);
    loop {
        match block_on(store.read(text.len(), &mut chunk))? {
            0 => return Ok(text),
            count => text.extend_from_slice(&chunk[..count]),
        }
    }
}

fn save(store: &mut impl Store, text: &[u8]) -> Result<(), StoreError> {
    block_on(async {
        for line in text.chunks(77) {
            store.append(line).await?;
        }
        store.commit().await
    })
}

#[test]
fn settings_survive_a_restart_and_a_chip_without_any_has_none() {
    let flash = Flash::new(2, 1);
    let mut store = block_on(FlashStore::open(flash.clone(), 0));
    let mut settings = Settings::new();
    assert_eq!(block_on(read_store(&mut store, &mut settings)), Ok(0));
    block_on(write_store(&settings, &mut store)).unwrap();
    let mut store = block_on(FlashStore::open(flash, 0));
    assert_eq!(block_on(read_store(&mut store, &mut settings)), Ok(1));
}

#[test]
fn the_longest_text_fits_again_and_again_and_a_longer_one_changes_nothing() {
    assert_eq!(text_bytes_max::<Flash>(), TEXT_BYTES_MAX);
    let flash = Flash::new(2, 2);
    let mut store = block_on(FlashStore::open(flash.clone(), 0));
    for fill in b'a'..b'h' {
        save(&mut store, &vec![fill; TEXT_BYTES_MAX]).unwrap();
    }
    assert_eq!(save(&mut store, &vec![b'x'; TEXT_BYTES_MAX + 1]), Err(StoreError::Full(TEXT_BYTES_MAX)));
    assert!(read(&mut store).unwrap() == vec![b'g'; TEXT_BYTES_MAX]);
    let mut store = block_on(FlashStore::open(flash, 0));
    assert!(read(&mut store).unwrap() == vec![b'g'; TEXT_BYTES_MAX]);
}

#[test]
fn a_save_that_was_given_up_is_no_part_of_the_next_one() {
    let store = block_on(FlashStore::open(Flash::new(2, 3), 0));
    let store = Mutex::<NoopRawMutex, _>::new(store);
    let mut gone = SharedStore::new(&store);
    block_on(gone.append(b"half a ")).unwrap();
    drop(gone);
    let mut console = SharedStore::new(&store);
    save(&mut console, b"whole").unwrap();
    assert_eq!(read(&mut console).unwrap(), b"whole");
}

#[test]
fn what_is_damaged_is_said_to_be_and_can_be_saved_over() {
    let flash = Flash::new(2, 4);
    save(&mut block_on(FlashStore::open(flash.clone(), 0)), b"port P1\n").unwrap();
    // Zeros may be written anywhere: over the first piece, behind the marks, the map's own word and the item's header.
    block_on(flash.clone().write(4 * 32, &[0; 32])).unwrap();
    let mut store = block_on(FlashStore::open(flash, 0));
    assert_eq!(read(&mut store), Err(StoreError::Damaged));
    save(&mut store, b"port P2\n").unwrap();
    assert_eq!(read(&mut store).unwrap(), b"port P2\n");
}
