//! Conformance: SDO, and what the gateway's objects take (statements 29 to 37).

use ethercat_subdevice::al_state::AlStatusCode;

use crate::prelude::*;

/// The same, and it tells its errors by emergencies.
static TELLING: Device = Device { emergencies: true, ..MAILBOX_128 };

fn rig() -> Rig<Bench> {
    Rig::in_state(&MAILBOX_128, PRE_OP)
}

fn gateway() -> Rig<GatewayObjects<'static>> {
    gateway_in(PRE_OP)
}

#[test]
fn statement_29_each_wrong_access_has_its_abort_code() {
    let mut rig = rig();
    assert_eq!(rig.upload(0x5000, 0), Err(0x0602_0000), "no such object");
    assert_eq!(rig.download(0x5000, 0, &[0]), Err(0x0602_0000));
    assert_eq!(rig.upload(0x1018, 5), Err(0x0609_0011), "no such sub-index");
    assert_eq!(rig.download(0x2105, 4, &[0]), Err(0x0609_0011));
    assert_eq!(rig.upload(0x1000, 1), Err(0x0609_0011));
    assert_eq!(rig.download(0x1000, 0, &[0; 4]), Err(0x0601_0002), "read only");
    assert_eq!(rig.download(0x1600, 0, &[0]), Err(0x0601_0002), "a PDO's content is fixed");
    assert_eq!(rig.upload(0x2102, 0), Err(0x0601_0001), "write only");
    assert_eq!(rig.download(0x2104, 0, &[10, 0]), Err(0x0607_0012), "too long");
    assert_eq!(rig.download(0x2105, 2, &[10]), Err(0x0607_0013), "too short");
    assert_eq!(rig.download(0x2100, 0, &[0; LARGE_BYTES - 1]), Err(0x0607_0013));
    assert_eq!(rig.download(0x2104, 0, &[9]), Err(0x0609_0032), "too small");
    assert_eq!(rig.download(0x2104, 0, &[21]), Err(0x0609_0031), "too great");
    assert_eq!(rig.download(0x1c32, 1, &[2, 0]), Err(0x0609_0030), "not one of the values");
    assert_eq!(rig.download(0x2106, 0, &[13]), Err(0x0800_0021), "the application's own reason");
    assert_eq!(rig.application().writes, 0, "nothing of it was written");
    for good in [10, 20] {
        assert_eq!(rig.download(0x2104, 0, &[good]), Ok(()));
    }
}

#[test]
fn statement_30_assignments_change_in_pre_op_only_and_with_their_count_at_0() {
    let mut rig = rig();
    assert_eq!(rig.download(0x1c12, 1, &[0x01, 0x16]), Err(0x0601_0003));
    assert_eq!(rig.download(0x1c12, 0, &[0]), Ok(()));
    assert_eq!(rig.download(0x1c12, 1, &[0x01, 0x1a]), Err(0x0604_0041), "an input's PDO");
    assert_eq!(rig.download(0x1c12, 1, &[0x77, 0x16]), Err(0x0604_0041), "no PDO");
    assert_eq!(rig.download(0x1c12, 1, &[0x01, 0x16]), Ok(()));
    assert_eq!(rig.download(0x1c12, 2, &[0x00, 0x16]), Ok(()));
    assert_eq!(rig.download(0x1c12, 0, &[2]), Err(0x0604_0042), "124 bytes");
    assert_eq!(rig.download(0x1c12, 0, &[9]), Err(0x0604_0042), "nine PDOs");
    assert_eq!(rig.download(0x1c12, 0, &[1]), Ok(()));
    assert_eq!(rig.upload(0x1c12, 1), Ok(vec![0x01, 0x16]));
    drop(rig);

    for state in [SAFE_OP, OP] {
        let mut rig = Rig::in_state(&MAILBOX_128, state);
        assert_eq!(rig.download(0x1c12, 0, &[0]), Err(0x0800_0022));
        assert_eq!(rig.download_complete(0x1c13, 0, &[0, 0]), Err(0x0800_0022));
        assert_eq!(rig.download(0x2103, 0, &[0, 0]), Err(0x0800_0022));
        assert_eq!(rig.download(0x2104, 0, &[10]), Ok(()));
    }
}

#[test]
fn statement_57_the_gateways_configuration_is_not_changed_while_process_data_are_exchanged() {
    let mut rig = gateway();
    assert_eq!(rig.download(0x2005, 1, &[1, 0]), Ok(()));
    assert_eq!(rig.upload(0x2005, 2), Ok(vec![1, 0]));
    rig.set_up_process_data();
    assert_eq!(rig.request(SAFE_OP), (SAFE_OP, 0));
    for (index, sub, value) in
        [(0x2000, 1, &[1, 0][..]), (0x2001, 1, &[7, 0]), (0x2020, 1, &[0x80, 0x25, 0, 0])]
    {
        assert_eq!(rig.download(index, sub, value), Err(0x0800_0022));
    }
    assert_eq!(rig.download(0x2005, 2, &[0, 0]), Ok(()));
    assert_eq!(rig.download(0x2001, 1, &[7, 0]), Ok(()));
}

#[test]
fn statement_59_synchronisation_is_told_by_the_entries_that_others_have() {
    let mut rig = rig();
    for index in [0x1c32, 0x1c33] {
        assert_eq!(rig.upload(index, 0), Ok(vec![0x20]));
        let sizes = [1, 2, 3, 4, 5, 6, 8, 9, 0x0a, 0x0b, 0x0c, 0x20]
            .map(|sub| (sub, rig.upload(index, sub).unwrap().len()));
        assert_eq!(sizes.map(|(_, bytes)| bytes), [2, 4, 4, 2, 4, 4, 2, 4, 4, 2, 2, 1]);
        for sub in (1..=0x21).filter(|sub| sizes.iter().all(|(known, _)| known != sub)) {
            assert_eq!(rig.upload(index, sub), Err(0x0609_0011), "{sub:02x}");
        }
        let complete = rig.upload_complete(index, 0).unwrap();
        assert_eq!(complete.len(), 2 + sizes.iter().map(|(_, bytes)| bytes).sum::<usize>());
        assert_eq!(rig.download(index, 8, &[2, 0]), Ok(()), "counters begin anew");
        assert_eq!(rig.download(index, 8, &[1, 0]), Err(0x0609_0030), "there is no measurement");
    }
    let types = |rig: &mut Rig<_>| rig.ask(&[0, 0x80, 3, 0, 0, 0, 0x00, 0x1c])[8..12].to_vec();
    assert_eq!(types(&mut rig), [5, 0, 4, 8], "1C00h is an ARRAY of USINT");
    assert_eq!(rig.upload_complete(0x1c00, 0), Ok(vec![4, 0, 1, 2, 3, 4]));
}

#[test]
fn statement_31_small_values_are_expedited_and_larger_ones_are_not() {
    let mut rig = rig();
    for (index, sub, command, value) in [
        (0x2104, 0, 0x4f, &[11][..]),
        (0x2105, 2, 0x4b, &[1, 2]),
        (0x2105, 3, 0x43, &[1, 2, 3, 4]),
        (0x2101, 0, 0x47, b"abc"),
    ] {
        rig.download(index, sub, value).unwrap();
        let [low, high] = u16::to_le_bytes(index);
        let response = rig.sdo(&[0x40, low, high, sub]).unwrap();
        assert_eq!((response[0], &response[4..4 + value.len()]), (command, value));
    }
    let response = rig.sdo(&[0x40, 0x08, 0x10, 0]).unwrap();
    assert_eq!((response[0], response[4..8].to_vec()), (0x41, 77u32.to_le_bytes().to_vec()));
}

#[test]
fn statement_31_a_long_value_passes_mailboxes_of_any_size() {
    let large: Vec<u8> = (0..LARGE_BYTES).map(|at| at as u8).collect();
    for device in [&MAILBOX_34, &MAILBOX_64, &MAILBOX_128] {
        let mut rig = Rig::in_state(device, PRE_OP);
        let name = rig.upload(0x1008, 0).unwrap();
        assert!(name.starts_with(b"A bench") && name.len() == 77);
        rig.download(0x2100, 0, &large).unwrap();
        assert_eq!(rig.application().writes, 1);
        assert_eq!(rig.upload(0x2100, 0).as_ref(), Ok(&large));
        for length in [0, 1, 4, 5, 8, 18, 19, 25, 26, 40] {
            rig.download(0x2101, 0, &large[..length]).unwrap();
            assert_eq!(rig.upload(0x2101, 0).unwrap(), large[..length], "{length} bytes");
        }
    }
}

#[test]
fn statement_32_segments_must_toggle() {
    let mut rig = Rig::in_state(&MAILBOX_64, PRE_OP);
    rig.sdo(&[0x40, 0x00, 0x21, 0]).unwrap();
    assert_eq!(rig.sdo(&[0x70]), Err(0x0503_0000), "the first has toggle 0");
    assert_eq!(rig.sdo(&[0x60]), Err(0x0504_0001), "that ended the upload");

    rig.sdo(&[0x40, 0x00, 0x21, 0]).unwrap();
    assert!(rig.sdo(&[0x60]).is_ok());
    assert_eq!(rig.sdo(&[0x60]), Err(0x0503_0000));

    rig.sdo(&[0x21, 0x00, 0x21, 0, 44, 1, 0, 0]).unwrap();
    assert_eq!(rig.sdo(&[0x10, 1, 2, 3, 4, 5, 6, 7]), Err(0x0503_0000));
    assert_eq!(rig.sdo(&[0x00, 1, 2, 3, 4, 5, 6, 7]), Err(0x0504_0001), "that ended the download");
}

#[test]
fn statement_32_segments_belong_to_an_open_transfer_of_their_kind() {
    let mut rig = Rig::in_state(&MAILBOX_64, PRE_OP);
    assert_eq!(rig.sdo(&[0x60]), Err(0x0504_0001));
    assert_eq!(rig.sdo(&[0x00]), Err(0x0504_0001));
    rig.sdo(&[0x40, 0x00, 0x21, 0]).unwrap();
    assert_eq!(rig.sdo(&[0x00]), Err(0x0504_0001), "an upload takes no data");
    rig.sdo(&[0x21, 0x00, 0x21, 0, 44, 1, 0, 0]).unwrap();
    assert!(rig.upload(0x1000, 0).is_ok(), "a new transfer ends the open one without a word");
    assert_eq!(rig.sdo(&[0x00, 1, 2, 3, 4, 5, 6, 7]), Err(0x0504_0001));
}

#[test]
fn statement_32_a_download_has_the_length_that_it_announced() {
    let mut rig = rig();
    rig.sdo(&[0x21, 0x01, 0x21, 0, 10, 0, 0, 0]).unwrap();
    assert_eq!(rig.sdo(&[0x01, 1, 2, 3, 4, 5, 6, 7]), Err(0x0607_0010), "less");
    rig.sdo(&[0x21, 0x01, 0x21, 0, 5, 0, 0, 0]).unwrap();
    assert_eq!(rig.sdo(&[0x01, 1, 2, 3, 4, 5, 6, 7]), Err(0x0607_0010), "more");
    let endless = rig.sdo(&[0x21, 0x01, 0x21, 0, 0xff, 0xff, 0, 0]);
    assert_eq!(endless, Err(0x0607_0012), "more than there could be");
    assert_eq!(rig.application().writes, 0);
}

#[test]
fn statement_32_an_abort_of_the_client_ends_the_transfer_without_a_response() {
    let mut rig = Rig::in_state(&MAILBOX_64, PRE_OP);
    rig.sdo(&[0x40, 0x00, 0x21, 0]).unwrap();
    assert_eq!(rig.send(&[0, 0x20, 0x80, 0x00, 0x21, 0, 0, 0, 0, 8]), 1);
    assert_eq!(rig.receive(), None);
    assert_eq!(rig.sdo(&[0x60]), Err(0x0504_0001));
}

#[test]
fn statement_33_complete_access_reads_from_sub_index_0_or_1() {
    let mut rig = rig();
    let identity = [0x1234_5678u32, 0x9abc_def0, 0x11, 0x22].map(u32::to_le_bytes).concat();
    assert_eq!(rig.upload_complete(0x1018, 1), Ok(identity.clone()));
    assert_eq!(rig.upload_complete(0x1018, 0), Ok([&[4, 0][..], &identity].concat()));
    assert_eq!(rig.upload_complete(0x1c12, 0), Ok(vec![1, 0, 0x00, 0x16]));
    let mapping = rig.upload_complete(0x1600, 0).unwrap();
    assert_eq!((mapping.len(), &mapping[..10]), (482, &[120, 0, 8, 1, 0, 0x30, 8, 2, 0, 0x30][..]));
    assert_eq!(rig.upload_complete(0x1018, 2), Err(0x0601_0000));
    assert_eq!(rig.upload_complete(0x1000, 0), Err(0x0601_0004), "one value");
    drop(rig);

    let mut gateway = gateway();
    let record = gateway.upload_complete(0x2001, 0).unwrap();
    assert_eq!((record.len(), &record[..4], &record[20..]), (24, &[10, 0, 1, 0][..], &[0xe8, 3, 0, 0][..]));
}

#[test]
fn statement_33_complete_access_writes_all_or_nothing() {
    let mut rig = rig();
    assert_eq!(rig.download_complete(0x2105, 1, &[7, 8, 0, 9, 0, 0, 0]), Ok(()));
    assert_eq!(rig.download_complete(0x2105, 0, &[3, 0, 17, 18, 0, 19, 0, 0, 0]), Ok(()));
    let record = vec![17, 18, 0, 19, 0, 0, 0];
    assert_eq!(rig.upload_complete(0x2105, 1).as_ref(), Ok(&record));

    let writes = rig.application().writes;
    for (bytes, abort) in [
        (&[101, 1, 0, 1, 0, 0, 0][..], 0x0609_0031),
        (&[1, 1, 0, 1, 0, 0], 0x0607_0013),
        (&[1, 1, 0, 1, 0, 0, 0, 0], 0x0607_0012),
    ] {
        assert_eq!(rig.download_complete(0x2105, 1, bytes), Err(abort));
    }
    assert_eq!(rig.download_complete(0x2105, 0, &[2, 0, 1, 1, 0, 1, 0, 0, 0]), Err(0x0609_0030), "its count");
    assert_eq!(rig.download_complete(0x2107, 1, &[1, 0, 7, 0]), Err(0x0601_0002), "one of them is read only");
    assert_eq!(rig.download_complete(0x2105, 2, &[1, 0, 1, 0, 0, 0]), Err(0x0601_0000));
    assert_eq!(rig.application().writes, writes);
    assert_eq!(rig.upload_complete(0x2105, 1), Ok(record));
}

#[test]
fn statement_33_complete_access_sets_an_assignment_at_once() {
    let mut rig = rig();
    assert_eq!(rig.download_complete(0x1c13, 0, &[1, 0, 0x01, 0x1a]), Ok(()));
    assert_eq!(rig.upload_complete(0x1c13, 0), Ok(vec![1, 0, 0x01, 0x1a]));
    for (bytes, abort) in [
        (&[2, 0, 0x01, 0x1a, 0x00, 0x1a][..], 0x0604_0042),
        (&[2, 0, 0x01, 0x1a, 0x01, 0x1a], 0x0604_0043),
        (&[1, 0, 0x00, 0x16], 0x0604_0041),
        (&[2, 0, 0x00, 0x1a], 0x0607_0013),
        (&[1, 0, 0x00, 0x1a, 0x01, 0x1a], 0x0607_0012),
    ] {
        assert_eq!(rig.download_complete(0x1c13, 0, bytes), Err(abort), "{bytes:02x?}");
        assert_eq!(rig.upload_complete(0x1c13, 0), Ok(vec![1, 0, 0x01, 0x1a]), "as it was");
    }
    assert_eq!(rig.download_complete(0x1c13, 0, &[0, 0]), Ok(()));
    assert_eq!(rig.upload(0x1c13, 0), Ok(vec![0]));
}

#[test]
fn statement_34_unknown_commands_are_aborted() {
    let mut rig = rig();
    for command in [0xa0, 0xc0, 0xe0] {
        assert_eq!(rig.sdo(&[command, 0x00, 0x10, 0]), Err(0x0504_0001));
    }
}

#[test]
fn statement_35_settings_out_of_range_are_refused_and_change_nothing() {
    let mut rig = gateway();
    rig.download(0x2005, 1, &[1, 0]).unwrap();
    let place = rig.application().shared();
    let before = place.configuration(|now| now.clone());
    rig.download(0x2005, 2, &[0, 0]).unwrap();
    for (index, sub, value, abort) in [
        (0x2000, 1, &[33, 0][..], 0x0609_0031),
        (0x2001, 1, &[0, 0], 0x0609_0032),
        (0x2001, 1, &[248, 0], 0x0609_0031),
        (0x2001, 10, &[0, 0, 0, 0], 0x0609_0032),
        (0x2005, 1, &[2, 0], 0x0609_0031),
        (0x2005, 2, &[1, 0], 0x0609_0031),
        (0x2020, 1, &[0, 0, 0, 0], 0x0609_0032),
        (0x2020, 2, &[2, 0], 0x0609_0031),
        (0x2020, 3, &[1, 0], 0x0609_0030),
        (0x2020, 3, &[4, 0], 0x0609_0031),
        (0x2020, 4, &[2, 0], 0x0609_0031),
    ] {
        assert_eq!(rig.download(index, sub, value), Err(abort), "{index:x}:{sub:x} {value:?}");
    }
    rig.download(0x2005, 1, &[1, 0]).unwrap();
    assert_eq!(place.configuration(|now| now.clone()), before);
}

#[test]
fn statement_35_a_configuration_that_does_not_fit_is_refused_as_a_whole() {
    for (count_sub, count, address) in [(8, 61, 0), (2, 961, 0), (4, 8, 65_530), (6, 1, 65_535)] {
        let mut rig = gateway();
        rig.download(0x2001, 8, &2u16.to_le_bytes()).unwrap();
        rig.download(0x2005, 1, &[1, 0]).unwrap();
        rig.download(0x2005, 2, &[0, 0]).unwrap();
        let layout = rig.upload_complete(0x2011, 0).unwrap();
        rig.download(0x2001, count_sub, &u16::to_le_bytes(count)).unwrap();
        rig.download(0x2001, count_sub + 1, &u16::to_le_bytes(address)).unwrap();
        let fits = (count_sub, count) == (6, 1);
        let expected = if fits { Ok(()) } else { Err(0x0604_0043) };
        assert_eq!(rig.download(0x2005, 1, &[1, 0]), expected);
        assert_eq!(rig.upload(0x2005, 2), Ok(vec![u8::from(fits), 0]));
        assert_eq!(rig.upload_complete(0x2011, 0).unwrap() == layout, !fits, "the layout stays");
    }
}

#[test]
fn statement_36_identity_types_and_sizes_agree_everywhere() {
    let mut rig = gateway();
    let image = sii_of(&GATEWAY);
    assert_eq!(rig.upload_complete(0x1018, 1).unwrap(), image[0x10..0x20]);
    let description = esi_of(&GATEWAY);
    for number in image[0x10..0x1c].as_chunks::<4>().0 {
        assert!(description.contains(&format!("#x{:08X}", u32::from_le_bytes(*number))));
    }

    assert_eq!(rig.upload_complete(0x1c00, 0), Ok(vec![4, 0, 1, 2, 3, 4]));
    for (assignment, buffer, sync_manager) in [(0x1c12, 0x2022, 2), (0x1c13, 0x2021, 3)] {
        let assigned = rig.upload_complete(assignment, 1).unwrap();
        let [pdo] = assigned.as_chunks::<2>().0 else { panic!("one PDO after power-on") };
        let mapping = rig.upload_complete(u16::from_le_bytes(*pdo), 1).unwrap();
        let bits: usize = mapping.as_chunks::<4>().0.iter().map(|entry| usize::from(entry[0])).sum();
        let size = usize::from(rig.upload(buffer, 0).unwrap()[0]);
        let sync_managers = category(&image, 41);
        let length = &sync_managers[8 * sync_manager + 2..][..2];
        assert_eq!((bits / 8, length), (size, &(size as u16).to_le_bytes()[..]));
        assert!(description.contains(&format!("DefaultSize=\"{size}\"")));
    }
}

/// The content of a category.
pub(crate) fn category(image: &[u8], wanted: u16) -> &[u8] {
    let word = |at: usize| u16::from_le_bytes([image[at], image[at + 1]]);
    let mut at = 0x80;
    while word(at) != wanted {
        assert_ne!(word(at), 0xffff, "category {wanted} is there");
        at += 4 + 2 * usize::from(word(at + 2));
    }
    &image[at + 4..at + 4 + 2 * usize::from(word(at + 2))]
}

#[test]
fn statement_37_an_emergency_tells_of_an_error_and_of_its_end_once_each() {
    let mut rig = Rig::in_state(&TELLING, PRE_OP);
    for _ in 0..3 {
        rig.request(SAFE_OP | ERROR);
    }
    let response = rig.receive().expect("an emergency");
    assert_eq!(response[6..], [0x00, 0x10, 0x00, 0xa0, 0x11, 0x1d, 0x00, 0, 0, 0]);
    rig.request(PRE_OP | ERROR);
    let response = std::iter::from_fn(|| rig.receive()).last().expect("the end of the error");
    assert_eq!(response[6..], [0x00, 0x10, 0, 0, 0, 0, 0, 0, 0, 0]);
    assert!(rig.upload(0x1000, 0).is_ok());
}

#[test]
fn statement_37_an_unread_emergency_never_blocks_sdo() {
    let mut rig = Rig::in_state(&TELLING, OP);
    for _ in 0..5 {
        rig.pass(200);
        assert_eq!(rig.status(), (SAFE_OP | ERROR, 0x001b));
        rig.cycle(0);
        rig.request(OP | ERROR);
    }
    assert_eq!(rig.send(&[0, 0x20, 0x40, 0x00, 0x10, 0, 0, 0, 0, 0]), 1, "a request is taken");
    let messages: Vec<_> = std::iter::from_fn(|| rig.receive()).collect();
    let emergencies = messages.iter().filter(|message| message[7] == 0x10).count();
    assert_eq!(messages.len(), emergencies + 1, "and answered");
    assert!(emergencies <= 6, "{emergencies}: at most one of each kind waits");
}

#[test]
fn statement_37_emergencies_can_be_off() {
    let mut rig = rig();
    rig.application().refuses = Some((AlState::SafeOp, AlStatusCode::HardwareNotReady));
    rig.set_up_process_data();
    rig.request(SAFE_OP);
    assert_eq!(rig.receive(), None);
}

/// A download to 2104h, expedited.
const WRITE: [u8; 10] = [0, 0x20, 0x2f, 0x04, 0x21, 0, 12, 0, 0, 0];

#[test]
fn statement_56_a_write_is_answered_when_it_has_ended_and_other_requests_wait() {
    let mut rig = Rig::in_state(&MAILBOX_128, OP);
    rig.application().writing = true;
    assert_eq!(rig.send(&WRITE), 1);
    assert_eq!(rig.send(&[0, 0x20, 0x40, 0x00, 0x10, 0, 0, 0, 0, 0]), 1, "the mailbox takes another one");
    for _ in 0..50 {
        rig.pass(10);
        assert_eq!(rig.cycle(1).1, 3, "process data go on");
        assert_eq!(rig.receive(), None);
    }
    rig.application().writing = false;
    rig.pass(2);
    let responses: Vec<u8> = std::iter::from_fn(|| rig.receive()).map(|message| message[8]).collect();
    assert_eq!(responses, [0x60, 0x43], "in their order");
    assert_eq!(rig.status(), (OP, 0));
}

#[test]
fn statement_56_a_write_that_failed_is_aborted_also_behind_its_last_segment() {
    let mut rig = rig();
    rig.application().write_error = Some(Abort::NotStored);
    assert_eq!(rig.download(0x2104, 0, &[12]), Err(0x0800_0020));
    assert_eq!(rig.download(0x2100, 0, &[7; LARGE_BYTES]), Err(0x0800_0020));
    rig.application().write_error = None;
    assert_eq!(rig.download(0x2100, 0, &[7; LARGE_BYTES]), Ok(()));
}

#[test]
fn statement_56_what_has_not_ended_in_init_is_not_answered_later() {
    let mut rig = rig();
    rig.application().writing = true;
    assert_eq!(rig.send(&WRITE), 1);
    rig.request(INIT);
    rig.application().writing = false;
    rig.pass(10);
    rig.bring_to(PRE_OP);
    rig.pass(10);
    assert_eq!(rig.receive(), None);
    assert!(rig.upload(0x1000, 0).is_ok());
}

#[test]
fn statement_30_pdos_with_the_same_content_are_not_assigned_together() {
    let mut rig = gateway();
    assert_eq!(rig.download_complete(0x1c12, 0, &[2, 0, 0x00, 0x16, 0x01, 0x16]), Err(0x0604_0043));
    assert_eq!(rig.download_complete(0x1c13, 0, &[2, 0, 0x01, 0x1a, 0x00, 0x1a]), Err(0x0604_0043));
    assert_eq!(rig.download_complete(0x1c12, 0, &[2, 0, 0x00, 0x16, 0x02, 0x16]), Ok(()));
}

#[test]
fn statement_10_pdos_that_do_not_hold_the_configured_image_keep_the_device_in_pre_op() {
    for (sub, assignment, other, code) in [(6, 0x1c13, 0x1a, 0x0024), (8, 0x1c12, 0x16, 0x0025)] {
        let mut rig = gateway();
        let (first, second) = (0, if other == 0x16 { 2 } else { 4 });
        let assign = |rig: &mut Rig<_>, pdos: &[u8]| {
            let list = pdos.iter().flat_map(|pdo| [*pdo, other]);
            let list: Vec<u8> = [pdos.len() as u8, 0].into_iter().chain(list).collect();
            rig.download_complete(assignment, 0, &list).unwrap();
        };
        assign(&mut rig, &[first, second]);
        // Holding registers are in both images: the inputs have room for them.
        rig.download_complete(0x1c13, 0, &[2, 0, 0x00, 0x1a, 0x04, 0x1a]).unwrap();
        rig.download(0x2100, sub, &61u16.to_le_bytes()).unwrap();
        rig.download(0x2005, 1, &[1, 0]).unwrap();
        assign(&mut rig, &[first]);
        rig.set_up_process_data();
        // Inputs of 256 bytes, where they have not become 120 again.
        if assignment == 0x1c12 {
            set_anew(&mut rig, Channel::Inputs, |block| block[2..4].copy_from_slice(&256u16.to_le_bytes()));
        }
        assert_eq!(rig.request(SAFE_OP), (PRE_OP | ERROR, code));
        rig.download(0x2005, 2, &[0, 0]).unwrap();
        assert_eq!(rig.request(SAFE_OP | ERROR), (SAFE_OP, 0), "without a configuration there is no image");
    }
}
