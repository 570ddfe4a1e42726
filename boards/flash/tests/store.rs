//! What a console and a start see of the store.

use std::cell::Cell;
use std::rc::Rc;

use embassy_futures::block_on;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use mobgate::gateway::saved::{read_store, write_store};
use mobgate::hal::{Store, StoreError};
use mobgate::language::LineBuffer;
use mobgate::settings::{PORTS_MAX, ROUTES_MAX, Settings};
use mobgate_clock as _;
use mobgate_flash::sectors::{MARKS_BYTES, Sectors};
use mobgate_flash::{FlashStore, Image, SharedStore, TEXT_BYTES_MAX, text_bytes_max};
use mobgate_simulator::flash::{PowerCut, SimFlash};
use mobgate_simulator::power_cuts::{read, save, text, versions};
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::map::{MapConfig, MapStorage};

/// As in an STM32H743: 32-byte words, sectors of 128 KiB.
type Flash = SimFlash<32, { 128 * 1024 }>;

fn open<F: NorFlash + Clone>(flash: &F) -> FlashStore<F> {
    block_on(FlashStore::open(flash.clone(), 0, Image::ONLY))
}

#[test]
fn settings_survive_a_restart_and_a_chip_without_any_has_none() {
    let flash = Flash::new(2, 1);
    let mut store = open(&flash);
    let (mut settings, mut line) = (Settings::new(), LineBuffer::default());
    assert_eq!(block_on(read_store(&mut store, &mut settings, &mut line, &mut |_, _, _| {})), Ok(0));
    block_on(write_store(&settings, &mut store, &mut line)).unwrap();
    let mut store = open(&flash);
    assert_eq!(block_on(read_store(&mut store, &mut settings, &mut line, &mut |_, _, _| {})), Ok(1));
}

#[test]
fn the_longest_text_fits_again_and_again_and_a_longer_one_changes_nothing() {
    // The lines of a host's settings are longer than those of a board's, for which these sectors are.
    const MOST: usize = text_bytes_max::<Flash>();
    const { assert!(MOST >= (PORTS_MAX + ROUTES_MAX + 1) * 641 && MOST <= TEXT_BYTES_MAX) };
    let flash = Flash::new(2, 2);
    let mut store = open(&flash);
    for fill in b'a'..b'h' {
        save(&mut store, &vec![fill; MOST]).unwrap();
    }
    assert_eq!(save(&mut store, &vec![b'x'; MOST + 1]), Err(StoreError::Full(MOST)));
    assert!(read(&mut store).unwrap() == vec![b'g'; MOST]);
    let mut store = open(&flash);
    assert!(read(&mut store).unwrap() == vec![b'g'; MOST]);
}

#[test]
fn a_save_that_was_given_up_is_no_part_of_the_next_one() {
    let store = open(&Flash::new(2, 3));
    let store = Mutex::<NoopRawMutex, _>::new(store);
    let mut gone = SharedStore::new(&store);
    block_on(gone.append(b"half a ")).unwrap();
    drop(gone);
    let mut console = SharedStore::new(&store);
    save(&mut console, b"whole").unwrap();
    assert_eq!(read(&mut console).unwrap(), b"whole");
}

#[test]
fn a_secret_is_made_once_and_survives_any_number_of_saves() {
    let flash = FineFlash::new(2, 6);
    let mut store = open(&flash);
    let no_numbers = block_on(store.secret(|_| false)).unwrap_err();
    assert!(no_numbers.to_string().contains("no random numbers"));
    let made = block_on(store.secret(|secret| {
        *secret = *b"32 bytes that nobody else knows!";
        true
    }));
    assert_eq!(made, Ok(*b"32 bytes that nobody else knows!"));
    let most = vec![b'x'; text_bytes_max::<FineFlash>()];
    for _ in 0..50 {
        save(&mut store, &most).unwrap();
        save(&mut store, b"").unwrap();
    }
    let kept = block_on(open(&flash).secret(|_| panic!("there is one")));
    assert_eq!(kept, made);
}

#[test]
fn what_is_corrupt_is_said_to_be_and_can_be_saved_over() {
    let flash = Flash::new(2, 4);
    save(&mut open(&flash), b"port P1\n").unwrap();
    // Zeros may be written anywhere: over the first piece, behind the marks, the map's own word and the item's header.
    block_on(flash.clone().write(4 * 32, &[0; 32])).unwrap();
    let mut store = open(&flash);
    assert_eq!(read(&mut store), Err(StoreError::Corrupt));
    save(&mut store, b"port P2\n").unwrap();
    assert_eq!(read(&mut store).unwrap(), b"port P2\n");
}

/// With short words, so that a part of what the map writes can be corrupted alone.
type FineFlash = SimFlash<4, { 8 * 1024 }>;

/// Where `bytes` stand in the flash.
fn place_of(flash: &FineFlash, bytes: &[u8]) -> u32 {
    let mut all = vec![0; flash.capacity()];
    block_on(flash.clone().read(0, &mut all)).unwrap();
    all.windows(bytes.len()).position(|window| window == bytes).unwrap() as u32
}

#[test]
fn settings_that_are_partly_of_an_older_save_are_corrupt_and_no_settings() {
    let flash = FineFlash::new(2, 5);
    let mut store = open(&flash);
    for text in ["port P1 rtu\n", "port P2 rtu\n", "port P3 rtu\n"] {
        save(&mut store, text.as_bytes()).unwrap();
    }
    assert_eq!(read(&mut store).unwrap(), b"port P3 rtu\n");
    // The item of the last text loses its check word, which makes it one that was taken back: the map then finds the item
    // before it, which is whole and as long. Between check word and text are a word of lengths and the key.
    let text = place_of(&flash, b"port P3");
    let check = (text - size_of::<u16>() as u32 - 2 * 4) & !3;
    block_on(flash.clone().write(check, &[0; 4])).unwrap();
    let mut store = open(&flash);
    assert_eq!(read(&mut store), Err(StoreError::Corrupt));
}

/// A flash with a fault.
#[derive(Clone)]
struct Faulty {
    flash: FineFlash,
    fault: Fault,
    /// So many operations from now one fails, once.
    left: Rc<Cell<Option<u32>>>,
}

#[derive(Clone, Copy, PartialEq)]
enum Fault {
    /// This value cannot be written: a bit of it turns, and no error says so.
    Worn(u8),
    /// An error correction is counted over each word, so that none may be written twice; and erasing fails.
    Strict,
    /// Writing fails though all has been written.
    Doubtful,
}

impl Faulty {
    fn new(seed: u64, fault: Fault) -> Self {
        Self { flash: FineFlash::new(2, seed), fault, left: Rc::default() }
    }

    fn fails(&self, fault: Fault) -> Result<(), PowerCut> {
        if self.fault != fault {
            return Ok(());
        }
        let left = self.left.get();
        self.left.set(left.and_then(|left| left.checked_sub(1)));
        if left == Some(0) { Err(PowerCut) } else { Ok(()) }
    }
}

impl ErrorType for Faulty {
    type Error = PowerCut;
}

impl ReadNorFlash for Faulty {
    const READ_SIZE: usize = FineFlash::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), PowerCut> {
        self.flash.read(offset, bytes).await
    }

    fn capacity(&self) -> usize {
        self.flash.capacity()
    }
}

impl NorFlash for Faulty {
    const WRITE_SIZE: usize = FineFlash::WRITE_SIZE;
    const ERASE_SIZE: usize = FineFlash::ERASE_SIZE;

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), PowerCut> {
        let mut written = bytes.to_vec();
        match self.fault {
            Fault::Worn(value) => {
                written.iter_mut().filter(|byte| **byte == value).for_each(|byte| *byte ^= 1)
            }
            Fault::Strict => {
                let mut there = vec![0; bytes.len()];
                self.flash.read(offset, &mut there).await?;
                assert!(there.iter().all(|&byte| byte == 0xff), "the word at {offset:#x} is written twice");
            }
            Fault::Doubtful => {}
        }
        self.flash.write(offset, &written).await?;
        self.fails(Fault::Doubtful)
    }

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), PowerCut> {
        self.fails(Fault::Strict)?;
        self.flash.erase(from, to).await
    }
}

#[test]
fn a_save_that_does_not_read_back_has_failed_and_the_old_settings_hold() {
    let worn = Faulty::new(6, Fault::Worn(b'~'));
    let mut store = open(&worn);
    save(&mut store, b"port good\n").unwrap();
    assert_eq!(save(&mut store, b"port ~\n"), Err(StoreError::Failed));
    assert_eq!(read(&mut store).unwrap(), b"port good\n");
    let mut store = open(&worn);
    assert_eq!(read(&mut store).unwrap(), b"port good\n", "also after a restart");
    save(&mut store, b"port better\n").unwrap();
    assert_eq!(read(&mut store).unwrap(), b"port better\n");
}

#[test]
fn whatever_word_is_corrupt_the_settings_are_whole_or_said_to_be_corrupt_and_then_can_be_saved_over() {
    let flash = FineFlash::new(2, 7);
    let mut store = open(&flash);
    save(&mut store, b"port P1 rtu\n").unwrap();
    save(&mut store, b"port P2 rtu\n").unwrap();
    let mut all = vec![0; flash.capacity()];
    block_on(flash.clone().read(0, &mut all)).unwrap();
    let mut corrupt = 0;
    for word in (0..flash.capacity()).step_by(4).filter(|&word| all[word..word + 4] != [0xff; 4]) {
        let flash = flash.copy(word as u64);
        block_on(flash.clone().write(word as u32, &[0; 4])).unwrap();
        let mut store = open(&flash);
        if let Ok(text) = read(&mut store) {
            let whole = [&b"port P2 rtu\n"[..], b"port P1 rtu\n", b""];
            assert!(whole.contains(&&*text), "word {word:#x}: {}", text.escape_ascii());
            continue;
        }
        corrupt += 1;
        assert_eq!(read(&mut store), Err(StoreError::Corrupt), "word {word:#x}");
        save(&mut store, b"port P3 rtu\n").unwrap_or_else(|error| panic!("word {word:#x}: {error:?}"));
        let mut store = open(&flash);
        assert_eq!(read(&mut store).unwrap(), b"port P3 rtu\n", "word {word:#x}");
    }
    assert!(corrupt > 3, "{corrupt}");
}

#[test]
fn after_an_erase_that_failed_no_word_is_written_twice_and_the_next_save_succeeds() {
    let strict = Faulty::new(8, Fault::Strict);
    let mut store = open(&strict);
    let mut failed = 0;
    for nth in 0..40 {
        strict.left.set(Some(0));
        let text = [b'a' + nth % 26; 900];
        if save(&mut store, &text).is_err() {
            failed += 1;
            assert_eq!(strict.left.get(), None, "the erase");
            save(&mut store, &text).unwrap();
        }
        assert!(read(&mut store).unwrap() == text, "save {nth}");
    }
    assert!(failed > 2, "{failed}");
}

#[test]
fn a_flash_that_cannot_be_prepared_is_left_alone_until_the_next_start() {
    let strict = Faulty::new(10, Fault::Strict);
    strict.left.set(Some(0));
    let mut store = open(&strict);
    let steps = strict.flash.steps();
    assert_eq!(read(&mut store), Err(StoreError::Failed));
    assert_eq!(save(&mut store, b"port P1\n"), Err(StoreError::Failed));
    assert_eq!(strict.flash.steps(), steps);
    let mut store = open(&strict);
    save(&mut store, b"port P1\n").unwrap();
    assert_eq!(read(&mut store).unwrap(), b"port P1\n");
}

#[test]
fn sectors_that_all_say_they_are_full_can_be_saved_over() {
    let flash = FineFlash::new(2, 11);
    save(&mut open(&flash), b"port P1\n").unwrap();
    let sector = FineFlash::ERASE_SIZE as u32;
    // The map's own first and last word of each, behind the marks.
    for word in [64, sector - 4, sector + 64, 2 * sector - 4] {
        block_on(flash.clone().write(word, &[0; 4])).unwrap();
    }
    let mut store = open(&flash);
    assert_eq!(read(&mut store), Err(StoreError::Corrupt));
    save(&mut store, b"port P2\n").unwrap();
    assert_eq!(read(&mut open(&flash)).unwrap(), b"port P2\n");
}

#[test]
fn after_a_save_that_failed_the_settings_are_those_of_the_next_start() {
    let (mut failed, mut old) = (0, 0);
    for left in 0.. {
        let doubtful = Faulty::new(9, Fault::Doubtful);
        let mut store = open(&doubtful);
        save(&mut store, b"port old\n").unwrap();
        doubtful.left.set(Some(left));
        if save(&mut store, b"port new\n").is_ok() {
            break;
        }
        let now = read(&mut store).unwrap();
        let mut store = open(&doubtful);
        assert_eq!(read(&mut store).unwrap(), now, "write {left}");
        failed += 1;
        old += u32::from(now == b"port old\n");
    }
    assert!(0 < old && old < failed, "{old} of {failed}: the new ones hold where the last write failed");
}

/// The map of a flash, as any firmware has it.
fn map(flash: &Flash) -> MapStorage<u16, Sectors<Flash>, Cache<Uncached, Uncached, Uncached, u16>> {
    let mut sectors = Sectors::new(flash.clone(), 0);
    block_on(sectors.prepare()).unwrap();
    let config = const { MapConfig::new(0..2 * (Flash::ERASE_SIZE - MARKS_BYTES) as u32) };
    MapStorage::new(sectors, config, Cache::new_uncached())
}

/// Stores a text in pieces with these keys, and a head that begins with `first`.
fn save_with(flash: &Flash, first: u8, keys: impl IntoIterator<Item = u16>, text: &[u8]) {
    let (mut map, mut buffer) = (map(flash), [0; 1024]);
    for (key, piece) in keys.into_iter().zip(text.chunks(1022)) {
        block_on(map.store_item(&mut buffer, &key, &piece)).unwrap();
    }
    let bit = |crc: u32, _| (crc >> 1) ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 };
    let crc = !text.iter().fold(!0, |crc, &byte| (0..8).fold(crc ^ u32::from(byte), bit));
    let head = [&[1, first][..], &(text.len() as u32).to_le_bytes(), &crc.to_le_bytes()].concat();
    block_on(map.store_item(&mut buffer, &u16::MAX, &&*head)).unwrap();
}

#[test]
fn two_copies_as_firmware_before_had_them_are_read_and_leave_room_for_the_longest_text() {
    let flash = Flash::new(2, 12);
    // The longest text of a board, and with each copy who saved it.
    let texts = [text(51_921, 1), text(51_921, 2)];
    for (copy, text) in (0..).zip(&texts) {
        save_with(&flash, copy as u8, copy * 0x100.., text);
        block_on(map(&flash).store_item(&mut [0; 1024], &(u16::MAX - 3 - copy), &&[b'a'; 62][..])).unwrap();
    }
    let mut store = open(&flash);
    assert!(read(&mut store).unwrap() == texts[1]);
    let versions = versions(&mut store);
    let nobody = ("-\t-\t".to_owned(), texts[1].clone());
    assert!(versions == if cfg!(feature = "versions") { vec![nobody] } else { Vec::new() });
    for seed in 3..9 {
        let text = text(text_bytes_max::<Flash>(), seed);
        save(&mut open(&flash), &text).unwrap();
        assert!(read(&mut open(&flash)).unwrap() == text);
    }
}

#[test]
fn a_text_in_both_halves_is_read_and_saved_over() {
    let flash = Flash::new(2, 13);
    let old = text(3_000, 1);
    // The last place of the first half, and two of the second one.
    save_with(&flash, 50 << 1, [50, 0x100, 0x101], &old);
    assert!(read(&mut open(&flash)).unwrap() == old);
    for seed in 2..6 {
        let text = text(text_bytes_max::<Flash>(), seed);
        save(&mut open(&flash), &text).unwrap();
        assert!(read(&mut open(&flash)).unwrap() == text);
    }
}

/// With versions, the place of a text is any.
#[cfg(not(feature = "versions"))]
#[test]
fn firmware_before_reads_what_is_saved_without_versions() {
    let flash = Flash::new(2, 14);
    for (nth, copy) in [0, 1, 0, 1].into_iter().enumerate() {
        let text = text(3_000, nth as u64);
        save(&mut open(&flash), &text).unwrap();
        let (mut map, mut buffer) = (map(&flash), [0; 1024]);
        let head = block_on(map.fetch_item::<&[u8]>(&mut buffer, &u16::MAX)).unwrap().unwrap();
        assert_eq!(head[..2], [1, copy as u8]);
        for (piece, number) in text.chunks(1022).zip(0..) {
            let key = copy * 0x100 + number;
            assert_eq!(block_on(map.fetch_item::<&[u8]>(&mut buffer, &key)).unwrap(), Some(piece));
        }
    }
}
