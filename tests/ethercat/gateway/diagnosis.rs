//! What a MainDevice is told of the gateway and its devices: the diagnosis history, the time, and emergencies.

use std::collections::BTreeMap;

use mobgate_simulator::Device;

use super::bench::with_wire;
use crate::esi::builder::{number, text};
use crate::prelude::*;

const SETTINGS: &str = "port bus serial uart1 rtu client 19200 8E1 timeout 100ms
    port ecat ethercat
    route ecat 1-247 * * bus";
const MESSAGE_BYTES: usize = 25;

/// The texts of the ESI file, by their numbers.
fn texts() -> BTreeMap<u16, String> {
    let file = esi_of(&GATEWAY);
    let document = Document::parse(&file).unwrap();
    let messages = document.descendants().filter(|node| node.has_tag_name("DiagMessage"));
    messages.map(|node| (number(text(node, "TextId")) as u16, text(node, "MessageText").to_owned())).collect()
}

/// A message as a tool shows it: severity, milliseconds, and its text with the parameters in it.
fn shown(message: &[u8]) -> (u8, u64, String) {
    let word = |at: usize| u16::from_le_bytes([message[at], message[at + 1]]);
    assert_eq!(word(0), 0xe000, "a code of the manufacturer");
    let mut text = texts()[&word(6)].clone();
    for parameter in message[16..].chunks(3).take(message[5].into()) {
        assert_eq!(parameter[..2], [5, 0]);
        text = text.replacen("%d", &parameter[2].to_string(), 1);
    }
    assert!(!text.contains('%'), "{text}");
    let nanoseconds = u64::from_le_bytes(message[8..16].try_into().unwrap());
    (message[4] & 0x0f, nanoseconds / 1_000_000, text)
}

#[test]
fn statement_60_the_history_tells_of_devices_that_are_silent_respond_again_and_refuse() {
    let device = Device::new(7);
    with_wire(19_200, SETTINGS, vec![device.clone()], async |dispatcher, _| {
        let group: Group<_> = dispatcher.to_pre_op().await.unwrap();
        let gateway = group.subdevice(dispatcher.master, 0).unwrap();
        assert_eq!(gateway.sdo_read::<u8>(0x10f3, 1).await.unwrap(), 20);
        gateway.sdo_write(0x2000, 1, 1_u16).await.unwrap();
        for (sub, value) in [(1, 7_u16), (8, 2), (9, 100)] {
            gateway.sdo_write(0x2001, sub, value).await.unwrap();
        }
        gateway.sdo_write(0x2001, 10, 100_u32).await.unwrap();
        gateway.sdo_write(0x2005, 1, 1_u16).await.unwrap();
        Timer::after_secs(2).await;
        assert_eq!(gateway.sdo_read::<u8>(0x10f3, 2).await.unwrap(), 0, "nothing has happened");

        let before = gateway.sdo_read::<u64>(0x10f8, 0).await.unwrap() / 1_000_000;
        device.set_faults(Faults::new(1).with(When::Always, Fault::Dead));
        Timer::after_secs(2).await;
        assert_eq!(gateway.sdo_read::<u8>(0x10f3, 4).await.unwrap(), 1, "there is a new one");
        device.set_faults(Faults::new(1).with(When::Always, Fault::Exception(4)));
        // It is tried again after 15 s, and refuses from then on.
        Timer::after_secs(20).await;
        assert_eq!(gateway.sdo_read::<u8>(0x10f3, 2).await.unwrap(), 8);
        let mut messages = Vec::new();
        for sub in 6..9 {
            messages.push(shown(&gateway.sdo_read::<[u8; MESSAGE_BYTES]>(0x10f3, sub).await.unwrap()));
        }
        let expected = [
            (2, "Modbus slave 0 does not respond"),
            (0, "Modbus slave 0 responds again"),
            (1, "Modbus slave 0 refuses a request by exception 4"),
        ];
        let texts = messages.iter().map(|(severity, _, text)| (*severity, text.as_str()));
        assert!(texts.eq(expected), "{messages:?}");
        let (silent, back) = (messages[0].1, messages[1].1);
        let in_time = (before..before + 2_000).contains(&silent) && back >= silent + 10_000;
        assert!(in_time, "{before}: {messages:?}");
        assert_eq!(gateway.sdo_read::<u8>(0x10f3, 4).await.unwrap(), 0, "the newest one was read");
        gateway.sdo_write(0x10f3, 3, 8_u8).await.unwrap();
        assert_eq!(gateway.sdo_read::<u8>(0x10f3, 3).await.unwrap(), 8);
        gateway.sdo_write(0x10f3, 3, 0_u8).await.unwrap();
        assert_eq!(gateway.sdo_read::<u8>(0x10f3, 2).await.unwrap(), 0, "none is left");
    });
}

/// A configuration that does not fit is to be taken over.
fn refuse(rig: &mut Rig<GatewayObjects<'static>>, count: u16) {
    rig.download(0x2001, 8, &count.to_le_bytes()).unwrap();
    assert_eq!(rig.sdo(&[0x2b, 0x05, 0x20, 1, 1, 0, 0, 0]), Err(0x0604_0043));
}

#[test]
fn statement_60_a_refused_configuration_is_told_and_wrong_acknowledgements_are_refused() {
    let mut rig = gateway_in(PRE_OP);
    refuse(&mut rig, 500);
    let (severity, _, text) = shown(&rig.upload(0x10f3, 6).unwrap());
    assert_eq!((severity, &*text), (2, "The configuration is refused: object 2006h says why"));
    assert_eq!(rig.download(0x10f3, 3, &[5]), Err(0x0609_0032));
    assert_eq!(rig.download(0x10f3, 3, &[7]), Err(0x0609_0031));
    assert_eq!(rig.download(0x10f3, 5, &[0x40, 0]), Err(0x0609_0030));
    assert_eq!(rig.download(0x10f3, 1, &[9]), Err(0x0601_0002));
    let all = rig.upload_complete(0x10f3, 0).unwrap();
    assert_eq!(all.len(), 2 + 6 + 20 * MESSAGE_BYTES);
    assert_eq!((all[0], all[2], all[3]), (25, 20, 6));
    for (sub, bytes) in [(1, 4), (2, 2)] {
        assert_eq!(rig.upload(0x10f1, sub), Ok(vec![0; bytes]));
    }
}

#[test]
fn statement_60_messages_are_sent_as_emergencies_to_whom_wants_them() {
    let mut rig = gateway_in(PRE_OP);
    refuse(&mut rig, 500);
    rig.pass(100);
    assert_eq!(rig.receive(), None, "nobody wants them after power-on");
    rig.download(0x10f3, 5, &[1, 0]).unwrap();
    rig.pass(100);
    assert_eq!(rig.receive(), None, "an older one is not sent");
    // The same message is told once, as long as it is the newest one.
    rig.download(0x10f3, 3, &[0]).unwrap();
    refuse(&mut rig, 501);
    rig.pass(100);
    assert_eq!(rig.receive().unwrap()[6..], [0x00, 0x10, 0x00, 0x63, 0x11, 4, 0, 0, 0, 0]);
    assert_eq!(rig.receive(), None);
    assert!(rig.upload(0x1000, 0).is_ok());
}

#[test]
fn statement_60_the_settings_say_whether_emergencies_are_sent_from_the_start() {
    let objects = gateway_objects();
    let place = objects.shared();
    let mut rig = Rig::with_application(&GATEWAY, objects);
    let mut settings = Settings::new();
    for (line, flags) in [
        ("port ecat ethercat emergencies", 1),
        ("edit port ecat on-loss hold", 1),
        ("edit port ecat no-emergencies", 0),
    ] {
        apply(&mut settings, line).unwrap();
        place.follow(&settings, false);
        rig.bring_to(PRE_OP);
        assert_eq!(rig.upload(0x10f3, 5), Ok(vec![flags, 0]), "{line}");
        rig.request(INIT);
    }
}
