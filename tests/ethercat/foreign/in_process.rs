//! The same routine in virtual time: ethercrab, and frames of our own.

use ethercrab::{EtherCrabWireRead, EtherCrabWireSized, SubIndex};
use ethercrab_wire::WireError;

use super::{Listing, WITH_MODULES, cycles, entries, modules, number};
use crate::gateway::modules::set_up;
use crate::information::list;
use crate::prelude::*;

/// Starts of a plain `cargo test`: more than in real time.
const STARTS: u32 = 30;

fn starts() -> u32 {
    number("MOBGATE_RESTARTS", STARTS)
}

/// What ethercrab has read, as it came.
struct Bytes(Vec<u8>);

impl EtherCrabWireRead for Bytes {
    fn unpack_from_slice(bytes: &[u8]) -> Result<Self, WireError> {
        Ok(Self(bytes.to_vec()))
    }
}

impl EtherCrabWireSized for Bytes {
    const PACKED_LEN: usize = 2_048;
    type Buffer = [u8; Self::PACKED_LEN];

    fn buffer() -> Self::Buffer {
        [0; Self::PACKED_LEN]
    }
}

/// An object as the device's table has it.
struct Listed {
    index: u16,
    entries: Vec<Listing>,
}

fn objects() -> Vec<Listed> {
    let listings = entries(&GATEWAY);
    let chunks = listings.chunk_by(|one, other| one.index == other.index);
    chunks.map(|entries| Listed { index: entries[0].index, entries: entries.to_vec() }).collect()
}

impl Listed {
    /// Whether it can be read as a whole: it has sub-indices, and no entry that is not readable.
    fn is_complete(&self) -> bool {
        self.entries.len() > 1 && self.entries.iter().enumerate().all(|(at, entry)| at == entry.sub.into())
    }

    /// What complete access must read when the entries are these.
    fn whole(&self, values: &[Vec<u8>]) -> Vec<u8> {
        let count = values[0][0];
        [vec![count, 0], values[1..=count.into()].concat()].concat()
    }
}

/// Prints how many cycles had a short working counter, which none may have.
fn demand(name: &str, short: u64) {
    at_most(&format!("{name}_short"), short, &format!("of {}", cycles()), 0);
}

/// Whether ethercrab can read `value`: 0.7.1 takes the response to a segment for one that it does not know.
fn fits_a_mailbox(value: &[u8]) -> bool {
    value.len() <= 128 - 6 - 2 - 8
}

/// The values of an object's entries, and the whole if it can be read so, as raw frames read them.
fn read(raw: &mut Rig<GatewayObjects<'static>>, object: &Listed) -> (Vec<Vec<u8>>, Option<Vec<u8>>) {
    let values = object.entries.iter().map(|entry| raw.upload(entry.index, entry.sub).unwrap()).collect();
    (values, object.is_complete().then(|| raw.upload_complete(object.index, 0).unwrap()))
}

/// The object that has another value at each reading (10F8h).
const TIME: u16 = 0x10f8;

#[test]
fn ethercrab_reads_all_objects() {
    // It keeps room for a list of 65 536 objects on the stack.
    const STACK_BYTES: usize = 16 << 20;
    let thread = std::thread::Builder::new().stack_size(STACK_BYTES);
    thread.spawn(read_all_objects_by_ethercrab).unwrap().join().unwrap();
}

fn read_all_objects_by_ethercrab() {
    let objects = objects();
    let mut raw = gateway_in(PRE_OP);
    let expected: Vec<_> = objects.iter().map(|object| read(&mut raw, object)).collect();
    drop(raw); // Its clock too.
    with_ethercrab(&GATEWAY, gateway_objects(), async |dispatcher| {
        let group = dispatcher.to_pre_op().await.unwrap();
        let device = group.subdevice(dispatcher.master, 0).unwrap();
        // Of the list itself 0.7.1 loses the end of each fragment but the first.
        let listed = device.sdo_info_object_quantities().await.unwrap().expect("it has a mailbox");
        assert_eq!(usize::from(listed.all), objects.len());
        for (object, (values, whole)) in objects.iter().zip(expected) {
            for (entry, expected) in object.entries.iter().zip(values).filter(|both| fits_a_mailbox(&both.1))
            {
                let value: Bytes = device.sdo_read(entry.index, entry.sub).await.unwrap();
                // The time goes on between two readings.
                if entry.index != TIME {
                    assert_eq!(value.0, expected, "{entry:x?}");
                }
            }
            if let Some(expected) = whole.filter(|whole| fits_a_mailbox(whole)) {
                let whole: Bytes = device.sdo_read(object.index, SubIndex::Complete).await.unwrap();
                // It begins with sub-index 1.
                assert_eq!(whole.0, expected[2..], "{:04x}", object.index);
            }
        }
    });
}

#[test]
fn ethercrab_exchanges_as_often_as_the_others() {
    with_ethercrab(&GATEWAY, SharedEcho::default(), async |dispatcher| {
        demand("ethercrab", exchange_by_ethercrab(dispatcher).await);
    });
}

#[test]
fn ethercrab_exchanges_the_process_data_of_modules_as_often_as_the_others() {
    with_ethercrab(&WITH_MODULES, modules().0, async |dispatcher| {
        demand("ethercrab_modules", exchange_by_ethercrab(dispatcher).await);
    });
}

/// How many cycles in Op have a short working counter.
async fn exchange_by_ethercrab(dispatcher: Dispatcher<'_>) -> u64 {
    let group = dispatcher.to_pre_op().await.unwrap();
    let group = dispatcher.to_op(group, 1).await.unwrap();
    let mut short = 0;
    for number in 2..u64::from(cycles()) + 2 {
        short += u64::from(dispatcher.exchange(&group, number).await.unwrap().1 != 3);
    }
    short
}

#[test]
fn ethercrab_starts_again_and_again() {
    with_ethercrab(&GATEWAY, SharedEcho::default(), start_by_ethercrab);
}

#[test]
fn ethercrab_starts_modules_again_and_again() {
    with_ethercrab(&WITH_MODULES, modules().0, start_by_ethercrab);
}

async fn start_by_ethercrab(dispatcher: Dispatcher<'_>) {
    for number in 1..=u64::from(starts()) {
        let group = dispatcher.to_pre_op().await.unwrap();
        let group = dispatcher.to_op(group, 2 * number).await.unwrap();
        assert_eq!(dispatcher.exchange(&group, 2 * number + 1).await.unwrap().1, 3);
        let group = group.into_safe_op(dispatcher.master).await.unwrap();
        group.into_pre_op(dispatcher.master).await.unwrap().into_init(dispatcher.master).await.unwrap();
    }
}

#[test]
fn raw_frames_read_all_objects() {
    let mut raw = gateway_in(PRE_OP);
    let listed = list(&mut raw, 1);
    let mut segmented = 0;
    for object in objects() {
        assert!(listed.contains(&object.index), "{:04x}", object.index);
        let (values, whole) = read(&mut raw, &object);
        for (entry, value) in object.entries.iter().zip(&values) {
            let fits = if entry.shorter { value.len() <= entry.bytes } else { value.len() == entry.bytes };
            assert!(fits, "{entry:x?} has {} bytes", value.len());
        }
        if let Some(whole) = whole {
            assert_eq!(whole, object.whole(&values), "{:04x}", object.index);
            segmented += u32::from(whole.len() > GATEWAY.memory.mailbox_bytes.into());
        }
    }
    assert!(segmented > 0, "some need more than a mailbox");
}

#[test]
fn raw_frames_exchange_as_often_as_the_others() {
    let mut raw = Rig::with_application(&GATEWAY, SharedEcho::default());
    raw.bring_to(OP);
    let bytes = GATEWAY.default_bytes(Channel::Outputs);
    let mut short = 0;
    for number in 1..=u64::from(cycles()) {
        short += u64::from(raw.exchange(&image(number, bytes.into())).1 != 3);
    }
    demand("raw", short);
    let application = raw.application();
    let echo = application.0.borrow();
    let counted = (echo.torn, echo.lost, echo.last);
    assert_eq!(counted, (1, 0, Some(cycles().into())), "torn are the zeros of the start");
}

#[test]
fn raw_frames_start_again_and_again() {
    let mut raw = Rig::with_application(&GATEWAY, SharedEcho::default());
    for start in 1..=starts() {
        raw.bring_to(OP);
        assert_eq!(raw.cycle(start as u8).1, 3, "start {start}");
        assert_eq!(raw.request(INIT), (INIT, 0), "start {start}");
    }
}

/// With modules, which are there by the settings: to Op, and what is exchanged there.
fn start_modules(raw: &mut Rig<GatewayObjects<'static>>) -> Vec<u8> {
    raw.bring_to(PRE_OP);
    let [outputs, inputs] = set_up(raw);
    let image = vec![0x5a; usize::from(outputs + inputs)];
    assert_eq!(raw.request(SAFE_OP), (SAFE_OP, 0));
    assert_eq!(exchange_modules(raw, &image), 3);
    assert_eq!(raw.request(OP), (OP, 0));
    image
}

/// The working counter of a cycle.
fn exchange_modules(raw: &mut Rig<GatewayObjects<'static>>, image: &[u8]) -> u16 {
    let counter = raw.segment.send_logical(Command::Lrw, LOGICAL, image).counter;
    raw.pass(1);
    counter
}

#[test]
fn raw_frames_exchange_the_process_data_of_modules_as_often_as_the_others() {
    let mut raw = Rig::with_application(&WITH_MODULES, modules().0);
    let image = start_modules(&mut raw);
    let short = (0..cycles()).filter(|_| exchange_modules(&mut raw, &image) != 3).count();
    demand("raw_modules", short as u64);
}

#[test]
fn raw_frames_start_modules_again_and_again() {
    let mut raw = Rig::with_application(&WITH_MODULES, modules().0);
    for start in 1..=starts() {
        start_modules(&mut raw);
        assert_eq!(raw.request(INIT), (INIT, 0), "start {start}");
    }
}
