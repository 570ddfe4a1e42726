//! Conformance: the Boot state (statement 63), and new firmware by pysoem.

use ethercat_subdevice::al_state::AlStatusCode;
use mobgate_simulator::esc::packet::{PacketSocket, serve};
use mobgate_simulator::own_network::{SEGMENT_END, in_own_network, start_master};

use crate::files::client::*;
use crate::outside::ends_well;
use crate::prelude::*;

#[test]
fn statement_63_boot_is_between_init_and_init() {
    for from in [PRE_OP, SAFE_OP, OP] {
        assert_eq!(rig(from).request(BOOT), (from | ERROR, 0x0011));
    }
    for to in [PRE_OP, SAFE_OP, OP] {
        assert_eq!(rig(BOOT).request(to), (BOOT | ERROR, 0x0011));
    }
    let mut rig = rig(BOOT);
    assert_eq!(rig.request(BOOT), (BOOT, 0));
    assert_eq!(rig.request(INIT), (INIT, 0));
    assert_eq!(rig.request(BOOT), (BOOT, 0), "the mailboxes are still set up");
    assert_eq!(rig.request(INIT), (INIT, 0));
    rig.bring_to(OP);
}

#[test]
fn statement_63_wrong_mailboxes_keep_it_in_init_with_0015_and_end_boot() {
    for channel in [Channel::MailboxOut, Channel::MailboxIn] {
        for (at, change) in [(0, 0x01), (2, 0x01), (4, 0x02), (4, 0x04), (6, 0x01)] {
            let mut rig = rig(INIT);
            rig.set_up_mailboxes();
            set_anew(&mut rig, channel, |block| block[at] ^= change);
            assert_eq!(rig.request(BOOT), (INIT | ERROR, 0x0015), "{channel:?}, byte {at} ^ {change:#x}");
        }
        let mut rig = rig(BOOT);
        rig.write(channel.registers() + 6, &[0]);
        assert_eq!(rig.status(), (INIT | ERROR, 0x0015));
    }
}

#[test]
fn statement_63_the_application_may_refuse_boot() {
    let mut rig = rig(INIT);
    rig.application().refuses = Some((AlState::Boot, AlStatusCode::HardwareNotReady));
    rig.set_up_mailboxes();
    assert_eq!(rig.request(BOOT), (INIT | ERROR, 0x0052));
}

#[test]
fn statement_63_in_boot_files_are_served_and_nothing_else() {
    let mut rig = rig(BOOT);
    for protocol in [1, 2, COE, 5, 15] {
        rig.send_counted(protocol, 0, &[0, 0x20, 0x40, 0x00, 0x10, 0, 0, 0, 0, 0]);
        let reply = rig.receive().unwrap();
        assert_eq!((reply[5] & 0x0f, &reply[6..]), (0, &[1, 0, 2, 0][..]), "protocol {protocol}");
    }
    assert_eq!(write(&mut rig, "firmware.bin", PASSWORD, &content(300), PACKET), None);
    assert_eq!(rig.application().files.stored["firmware.bin"], content(300));
}

#[test]
fn statement_63_a_device_without_files_answers_that_it_does_not_know_them() {
    let mut rig = Rig::in_state(&MAILBOX_128, PRE_OP);
    rig.send_counted(FOE, 0, &[READ, 0, 0, 0, 0, 0, b'x']);
    assert_eq!(rig.receive().unwrap()[6..], [1, 0, 2, 0]);
}

/// pysoem writes and reads files of these lengths; the application takes `delay` for each call.
fn with_pysoem(test: &str, delay: Duration, lengths: &[usize]) {
    in_own_network(test, || {
        let line = line_of(&FILES_128);
        let (esc, mut interrupt) = direct(line.borrow().chip(0));
        let application = Shared::new(Bench::default());
        application.0.borrow_mut().files.delay = delay;
        let mut sub_device = SubDevice::new(&FILES_128, esc, application.clone());
        let socket = PacketSocket::open(SEGMENT_END).unwrap();
        let readme = concat!(env!("CARGO_MANIFEST_DIR"), "/ethercat/subdevice/README.md");
        let mut arguments =
            [readme, "firmware.bin", &PASSWORD.to_string(), "x.conf"].map(str::to_owned).to_vec();
        arguments.extend(lengths.iter().map(usize::to_string));
        let mut script = start_master("files.py", &arguments);
        let device = sub_device.run(async || interrupt.wait_for_high().await.unwrap());
        match serve(&socket, &line, select(device, ends_well(&mut script))).unwrap() {
            Either::First(never) => never,
            Either::Second(()) => {}
        }
        let files = &application.0.borrow().files;
        let stored = files.stored.iter().map(|(name, bytes)| (name.as_str(), bytes.len()));
        let last = *lengths.last().unwrap();
        assert_eq!(stored.collect::<Vec<_>>(), [("firmware.bin", last), ("x.conf", last)]);
        assert_eq!((files.finished, files.aborted), (3 * lengths.len(), 0));
    });
}

#[test]
fn pysoem_writes_firmware_in_boot_as_the_readme_says_and_other_files_elsewhere() {
    let test = "boot::pysoem_writes_firmware_in_boot_as_the_readme_says_and_other_files_elsewhere";
    with_pysoem(test, Duration::from_ticks(0), &[1, PACKET - 1, PACKET, PACKET + 1, 20 * PACKET, 30_000]);
}

#[test]
fn pysoem_is_patient_with_slow_flash() {
    let test = "boot::pysoem_is_patient_with_slow_flash";
    with_pysoem(test, Duration::from_millis(250), &[2 * PACKET, 2 * PACKET + 1]);
}
