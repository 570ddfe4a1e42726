//! The model of the LAN9252 judges its driver: everything that must not be done is noticed.

use embedded_hal_async::spi::SpiDevice;
use ethercat_esc::lan9252::{Spi, Timing};
use ethercat_esc::now;
use ethercat_esc::{Lan9252, World};

use ethercat_esc::samples::ready;

const CSR: u16 = 0x300;
const READ_PLACE: u16 = 0x308;
const WRITE_PLACE: u16 = 0x310;
const READ_FIFO: u16 = 0x000;
const WRITE_FIFO: u16 = 0x020;
const INCREMENT: u16 = 0x4000;
const START: u32 = 1 << 31;

async fn write(spi: &mut Spi, address: u16, words: &[u32]) {
    let mut bytes = vec![0x02];
    bytes.extend(address.to_be_bytes());
    words.iter().for_each(|word| bytes.extend(word.to_le_bytes()));
    spi.write(&bytes).await.unwrap();
}

async fn read(spi: &mut Spi, address: u16, words: usize) -> Vec<u32> {
    let mut bytes = vec![0; 3 + 4 * words];
    bytes[0] = 0x03;
    bytes[1..3].copy_from_slice(&address.to_be_bytes());
    spi.transfer_in_place(&mut bytes).await.unwrap();
    bytes[3..].chunks(4).map(|word| u32::from_le_bytes(word.try_into().unwrap())).collect()
}

/// What the model has to say about `driver`, without the times.
fn said(driver: impl AsyncFnOnce(&mut Spi)) -> Vec<String> {
    let mut world = World::new(1);
    let chip = Lan9252::new(ready().chip(0), Timing { test_nanos: 0, ready_nanos: 0, ..Timing::USUAL });
    world.run_until(driver(&mut chip.spi()));
    let about = |violation: &String| violation.split_once(": ").unwrap().1.to_owned();
    chip.violations().iter().map(about).collect()
}

fn register_command(size: u32, address: u32) -> u32 {
    START | 1 << 30 | size << 16 | address
}

#[test]
fn good_accesses_are_not_objected_to() {
    let violations = said(async |spi| {
        assert_eq!(read(spi, 0x064, 1).await, [0x8765_4321]);
        write(spi, CSR + 4, &[register_command(4, 0x0000)]).await;
        assert_eq!(read(spi, 0x8000 | (CSR + 4), 2).await, [0x4004_0000, 0x0000_02C0], "command, then data");
        write(spi, WRITE_PLACE | INCREMENT, &[0x0008_1800, START]).await;
        write(spi, WRITE_FIFO, &[0x0403_0201, 0x0807_0605]).await;
        assert_eq!(read(spi, WRITE_PLACE | INCREMENT, 2).await, [0x1808, 0x1001], "all moved, sixteen free");
        write(spi, READ_PLACE | INCREMENT, &[0x0008_1800, START]).await;
        assert_eq!(read(spi, READ_PLACE | INCREMENT, 2).await, [0x1808, 0x0201], "two wait");
        assert_eq!(read(spi, READ_FIFO, 2).await, [0x0403_0201, 0x0807_0605]);
    });
    assert_eq!(violations, [] as [String; 0]);
}

#[test]
fn statement_53_register_accesses_whose_size_does_not_fit_are_noticed() {
    for (size, address) in [(4, 2), (4, 1), (2, 1), (2, 3), (3, 0), (0, 0), (8, 0)] {
        let violations = said(async |spi| write(spi, CSR + 4, &[register_command(size, address)]).await);
        assert_eq!(
            violations,
            ["register access whose size does not fit its address"],
            "{size} at {address}"
        );
    }
    let violations = said(async |spi| write(spi, CSR + 4, &[register_command(4, 0x1000)]).await);
    assert_eq!(violations, ["register access to process data memory"]);
}

#[test]
fn statement_53_a_register_command_while_one_is_under_way_is_noticed() {
    let mut world = World::new(1);
    let chip = Lan9252::new(ready().chip(0), Timing { test_nanos: 0, ready_nanos: 0, ..Timing::USUAL });
    let mut spi = chip.spi();
    world.run_until(async {
        chip.hang_registers();
        write(&mut spi, CSR + 4, &[register_command(4, 0)]).await;
        write(&mut spi, CSR | INCREMENT, &[0, register_command(4, 0)]).await;
    });
    assert_eq!(chip.violations().len(), 2, "data and command: {:?}", chip.violations());
    assert!(now() < 1_000_000);
}

#[test]
fn statement_53_transfers_outside_of_process_data_memory_are_noticed() {
    for place in [0x0004_0F80, 0x0004_0FFE, 0x0004_1FFE, 0x0000_1800] {
        let violations = said(async |spi| write(spi, READ_PLACE | INCREMENT, &[place, START]).await);
        assert_eq!(violations, ["transfer outside of process data memory"], "{place:#x}");
    }
}

#[test]
fn statement_53_a_fifo_that_runs_empty_or_over_is_noticed() {
    let violations = said(async |spi| {
        write(spi, READ_PLACE | INCREMENT, &[0x0008_1800, START]).await;
        read(spi, READ_PLACE, 1).await;
        read(spi, READ_FIFO, 3).await;
    });
    assert_eq!(violations, ["fetched from an empty FIFO"]);
    let violations = said(async |spi| {
        write(spi, WRITE_PLACE | INCREMENT, &[0x0008_1800, START]).await;
        write(spi, WRITE_FIFO, &[0; 3]).await;
    });
    assert_eq!(violations, ["more data than the transfer is long"]);
    let mut world = World::new(1);
    let timing = Timing { test_nanos: 0, ready_nanos: 0, fifo_nanos: 1_000_000, ..Timing::USUAL };
    let chip = Lan9252::new(ready().chip(0), timing);
    let mut spi = chip.spi();
    world.run_until(async {
        write(&mut spi, WRITE_PLACE | INCREMENT, &[0x0080_1800, START]).await;
        write(&mut spi, WRITE_FIFO, &[0; 20]).await;
    });
    assert!(chip.violations().iter().all(|violation| violation.ends_with("pushed into a full FIFO")));
    assert_eq!(chip.violations().len(), 3, "one is moved, sixteen wait: {:?}", chip.violations());
}

#[test]
fn statement_53_a_transfer_on_top_of_an_unfinished_one_is_noticed_unless_it_was_aborted() {
    let twice = async |spi: &mut Spi, aborted: bool| {
        write(spi, READ_PLACE | INCREMENT, &[0x0080_1800, START]).await;
        if aborted {
            write(spi, READ_PLACE + 4, &[1 << 30]).await;
        }
        write(spi, READ_PLACE | INCREMENT, &[0x0080_1800, START]).await;
    };
    assert_eq!(said(async |spi| twice(spi, true).await), [] as [String; 0]);
    let violations = said(async |spi| twice(spi, false).await);
    let expected = [
        "address and length changed during a transfer",
        "transfer started in the middle of another, without an abort",
    ];
    assert_eq!(violations, expected);
}

#[test]
fn statement_53_both_directions_in_the_same_memory_are_noticed() {
    let violations = said(async |spi| {
        write(spi, WRITE_PLACE | INCREMENT, &[0x0008_1800, START]).await;
        write(spi, READ_PLACE | INCREMENT, &[0x0080_1804, START]).await;
    });
    assert_eq!(violations, ["both directions at once in the same memory"]);
}

#[test]
fn odd_transactions_are_noticed() {
    let raw = |bytes: &'static [u8]| said(async move |spi: &mut Spi| spi.write(bytes).await.unwrap());
    assert_eq!(raw(&[0x02, 0x00, 0x54, 1, 2]), ["transaction that ends inside of a double word"]);
    assert_eq!(raw(&[0x03, 0x00, 0x55, 0, 0, 0, 0]).len(), 2, "no double word's address, no such register");
    assert_eq!(raw(&[0x9F, 0, 0]), ["instruction 0x9f, which this model does not know"]);
    assert_eq!(raw(&[0x02, 0x02, 0x00, 0, 0, 0, 0]), ["write to a register that is not there"]);
}
