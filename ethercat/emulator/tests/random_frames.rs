//! Frames of any content, one after the other: the chip takes each of them without a panic, and what it gives back fits.

use ethercat_esc::frame::{Builder, FRAME_BYTES_MAX, datagrams, is_ethercat, is_whole};
use ethercat_esc::{Chip, Command, Kind};
use proptest::collection::vec;
use proptest::prelude::*;
use strum::VariantArray;

/// Where registers have effects, and around the limits of the memory.
const PLACES: [u16; 13] =
    [0x0010, 0x0040, 0x0100, 0x0120, 0x0200, 0x0500, 0x0600, 0x0800, 0x0900, 0x0980, 0x1000, 0x1FC0, 0xFFF0];

/// A command at an address where something happens, with data.
fn datagram() -> impl Strategy<Value = (Command, u32, Vec<u8>)> {
    let physical = (0..2_u32, prop::sample::select(&PLACES[..]), 0..0x80_u32)
        .prop_map(|(device, place, offset)| ((u32::from(place) + offset) & 0xFFFF) << 16 | device);
    let address = prop_oneof![4 => physical, 1 => 0..0x4000_u32, 1 => any::<u32>()];
    let byte = prop_oneof![Just(0), Just(1), Just(0xFF), any::<u8>()];
    (prop::sample::select(Command::VARIANTS), address, vec(byte, 0..100))
}

/// A limit of a range of addresses, or anything.
fn number() -> impl Strategy<Value = u16> {
    prop_oneof![Just(0), Just(1), Just(0x1000), Just(0x1FFF), Just(0x7FFF), Just(0xFFFF), any::<u16>()]
}

/// The registers of a SyncManager, of an FMMU or of the clock, switched on with any values.
fn setup() -> impl Strategy<Value = (Command, u32, Vec<u8>)> {
    let control = prop::sample::select(&[0x26, 0x22, 0x64, 0x24, 0x20, 0x66][..]);
    let manager = (0..4_u16, number(), number(), control).prop_map(|(nth, start, length, control)| {
        (0x0800 + 8 * nth, [&start.to_le_bytes()[..], &length.to_le_bytes(), &[control, 0, 1, 0]].concat())
    });
    let fmmu = (0..3_u16, [number(), number(), number(), number()], any::<[u8; 4]>());
    let fmmu = fmmu.prop_map(|(nth, [low, high, length, physical], [first, last, bit, kind])| {
        let words = [low, high, length].map(u16::to_le_bytes).concat();
        let rest = [[first, last].as_slice(), &physical.to_le_bytes(), &[bit, kind, 1, 0, 0, 0]].concat();
        (0x0600 + 16 * nth, [words, rest].concat())
    });
    let time =
        || prop_oneof![0..10_000_000_u64, (0..1_000_000_u64).prop_map(|less| u64::MAX - less), any::<u64>()];
    let offset = time().prop_map(|time| (0x0920, time.to_le_bytes().to_vec()));
    let start = time().prop_map(|time| (0x0990, time.to_le_bytes().to_vec()));
    let cycle = number().prop_map(|cycle| (0x09A0, vec![cycle as u8, (cycle >> 8) as u8, 0, 0]));
    let activation = prop_oneof![Just(vec![0]), Just(vec![3])].prop_map(|bytes| (0x0981, bytes));
    let registers =
        prop_oneof![3 => manager, 3 => fmmu, 1 => offset, 1 => start, 1 => cycle, 1 => activation];
    registers.prop_map(|(address, bytes)| (Command::Bwr, u32::from(address) << 16, bytes))
}

/// A frame as MainDevices send them.
fn frame() -> impl Strategy<Value = Vec<u8>> {
    vec(prop_oneof![datagram(), setup()], 1..5).prop_map(|datagrams| {
        let add = |frame: Builder, (command, address, data): (Command, u32, Vec<u8>)| {
            frame.logical(command, address, &data)
        };
        datagrams.into_iter().fold(Builder::default(), add).build()
    })
}

/// The same with some bytes changed, cut short, or nothing of the kind.
fn any_frame() -> impl Strategy<Value = Vec<u8>> {
    let changes = vec((any::<prop::sample::Index>(), any::<u8>()), 0..4);
    let changed = (frame(), changes, any::<prop::sample::Index>(), any::<bool>()).prop_map(
        |(mut frame, changes, end, cut)| {
            for (at, byte) in changes {
                let at = at.index(frame.len());
                frame[at] = byte;
            }
            if cut {
                frame.truncate(end.index(frame.len()));
            }
            frame
        },
    );
    prop_oneof![4 => frame(), 4 => changed, 1 => vec(any::<u8>(), 0..FRAME_BYTES_MAX)]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn any_sequence_of_frames_passes_or_is_dropped(
        frames in vec((any_frame(), 0..1_000_000_000_u64, prop::bool::weighted(0.9)), 1..20),
        accesses in vec((any::<u16>(), vec(any::<u8>(), 0..300)), 20),
    ) {
        let mut chip = Chip::new(Kind::LAN9252, vec![]);
        let mut now = 0;
        for ((mut frame, pause, good), (address, mut bytes)) in frames.into_iter().zip(accesses) {
            now += pause;
            let before = frame.clone();
            let passed = chip.pass_on(now, &mut frame, None, good);
            prop_assert_eq!(passed, is_ethercat(&before));
            prop_assert_eq!(frame.len(), before.len());
            prop_assert!(passed || frame == before, "what is not for the chip stays as it is");
            prop_assert_eq!(is_whole(&frame), is_whole(&before));
            // The processor goes on meanwhile.
            chip.read(now, address, &mut bytes);
            chip.write(now, address, &bytes);
            chip.interrupt(now);
            chip.next_change(now);
        }
    }

    #[test]
    fn whole_frames_have_all_their_datagrams(mut frame in any_frame()) {
        let whole = is_whole(&frame);
        let count = datagrams(&mut frame).count();
        prop_assert!(!whole || count > 0);
    }

    #[test]
    fn frames_as_main_devices_send_them_are_whole_unless_they_are_cut(frame in frame()) {
        prop_assert!(is_whole(&frame));
        let body = usize::from(u16::from_le_bytes([frame[14], frame[15]]) & 0x07FF);
        prop_assert!(!is_whole(&frame[..16 + body - 1]));
    }
}
