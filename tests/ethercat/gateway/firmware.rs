//! New firmware by FoE, in Boot and only there.

use mobgate::fieldbus::{FileBuffer, updatable_device};
use mobgate::frame::FramePool;
use mobgate::gateway::{Gateway, Ports};
use mobgate::hal::{System, UpdateError};
use mobgate_simulator::esc::packet::{PacketSocket, serve};
use mobgate_simulator::firmware::Firmware;
use mobgate_simulator::own_network::{SEGMENT_END, in_own_network, start_master};
use std::cell::Cell;

use crate::files::client::*;
use crate::outside::ends_well;
use crate::prelude::*;

type Objects = GatewayObjects<'static, &'static FileBuffer>;

/// Counts restarts.
#[derive(Clone, Default)]
struct Restarts(Rc<Cell<u32>>);

impl System for Restarts {
    fn name(&self) -> &str {
        "bench"
    }

    fn reboot(&self) {
        self.0.set(self.0.get() + 1);
    }
}

/// As long as the test.
fn leak<T>(value: T) -> &'static T {
    Box::leak(Box::new(value))
}

/// The owner of the flash.
async fn owner(buffer: &FileBuffer, mut firmware: Firmware, restarts: Restarts) {
    let pool = FramePool::new(&[], 0);
    let ports = Ports::<0>::new();
    Gateway::new(&pool, &ports, &[]).take_firmware(buffer, &mut firmware, &restarts).await
}

/// A gateway in `state` whose flash takes firmware.
fn updatable(state: u16, modules: bool) -> (Rig<Objects>, Firmware, Restarts) {
    let place = place_with(if modules { "port ecat ethercat modules" } else { "port ecat ethercat" });
    let buffer = leak(FileBuffer::new());
    let objects = if modules { GatewayObjects::modular(place) } else { GatewayObjects::new(place) };
    let mut rig = Rig::with_application(updatable_device(modules), objects.with_files(buffer));
    let (firmware, restarts) = (Firmware::default(), Restarts::default());
    let owner = owner(buffer, firmware.clone(), restarts.clone());
    rig.world.spawn(owner);
    rig.bring_to(state);
    (rig, firmware, restarts)
}

#[test]
fn an_image_is_taken_in_boot_and_starts_when_boot_is_left() {
    for (modules, name) in [(false, "firmware.mgu"), (true, "NUCLEO_H743ZI-0.5.0.MGU")] {
        for length in [1, PACKET, PACKET + 1, 5_000] {
            let (mut rig, firmware, restarts) = updatable(BOOT, modules);
            assert_eq!(write(&mut rig, name, 0, &content(length), PACKET), None);
            assert_eq!(firmware.taken(), [content(length)]);
            assert_eq!(firmware.announced(), (None, false), "nobody is at the gateway");
            rig.pass(2_000);
            assert_eq!(restarts.0.get(), 0);
            assert_eq!(rig.request(INIT), (INIT, 0));
            rig.pass(100);
            assert_eq!(restarts.0.get(), 0, "the MainDevice must see the state");
            rig.pass(1_000);
            assert_eq!(restarts.0.get(), 1);
        }
    }
}

#[test]
fn other_files_do_not_exist_and_images_are_for_boot_and_never_read() {
    let (mut rig, ..) = updatable(BOOT, false);
    for name in ["firmware.bin", "mgu", ".mg", "", "ä.mgux"] {
        assert_eq!(code(ask(&mut rig, WRITE, 0, name.as_bytes())), 0x8001, "{name}");
    }
    assert_eq!(code(ask(&mut rig, READ, 0, b"x")), 0x8001);
    assert_eq!(code(ask(&mut rig, READ, 0, b"firmware.mgu")), 0x8002);
    drop(rig);
    let (mut rig, firmware, restarts) = updatable(PRE_OP, false);
    assert_eq!(code(ask(&mut rig, WRITE, 0, b"firmware.mgu")), 0x8008);
    assert_eq!(rig.request(INIT), (INIT, 0));
    rig.pass(2_000);
    assert_eq!((firmware.unfinished(), restarts.0.get()), (None, 0));
}

#[test]
fn a_gateway_without_updates_has_neither_boot_nor_foe() {
    let mut rig = gateway_in(PRE_OP);
    send(&mut rig, WRITE, 0, b"firmware.mgu");
    assert_eq!(rig.receive().unwrap()[6..], [1, 0, 2, 0], "an unsupported protocol");
    drop(rig);
    let mut rig = gateway_in(INIT);
    rig.set_up_mailboxes();
    assert_eq!(rig.request(BOOT), (INIT | ERROR, 0x0013));
    let esi = |device| esi_of(device);
    assert!(!esi(&GATEWAY).contains("FoE") && !esi(&GATEWAY).contains("BootStrap"));
    for modules in [false, true] {
        let esi = esi(updatable_device(modules));
        assert!(esi.contains("<FoE/>") && esi.contains("<BootStrap>"), "{modules}");
    }
}

#[test]
fn what_is_refused_has_a_code_and_the_reason_in_words() {
    for (bytes, why, number) in [
        (1, UpdateError::NotAnImage, 0x8010),
        (1_500, UpdateError::OtherBoard, 0x800d),
        (1_500, UpdateError::Older, 0x8002),
        (4_000, UpdateError::TooLong, 0x8003),
        (4_000, UpdateError::Failed, 0x8011),
        (usize::MAX, UpdateError::Signature, 0x800c),
        (usize::MAX, UpdateError::Truncated, 0x800c),
    ] {
        let (mut rig, firmware, restarts) = updatable(BOOT, false);
        firmware.refuse(bytes, why);
        let response = write(&mut rig, "firmware.mgu", 0, &content(5_000), PACKET);
        let (operation, code, text) = response.expect("it is refused");
        assert_eq!((operation, code), (ERR, number), "{why:?}");
        assert_eq!(String::from_utf8(text).unwrap(), why.to_string());
        assert_eq!(rig.request(INIT), (INIT, 0));
        rig.pass(2_000);
        assert_eq!((firmware.taken().len(), firmware.unfinished(), restarts.0.get()), (0, None, 0));
    }
}

#[test]
fn slow_flash_makes_the_gateway_busy_and_a_transfer_that_ends_early_is_discarded() {
    let (mut rig, firmware, restarts) = updatable(BOOT, false);
    firmware.set_pace(Duration::from_millis(350));
    assert_eq!(ask(&mut rig, WRITE, 0, b"firmware.mgu"), ack(0));
    let mut busy = 0;
    loop {
        send(&mut rig, DATA, 1, &content(PACKET));
        rig.pass(110);
        match received(&mut rig) {
            Some((BUSY, ..)) => busy += 1,
            response => break assert_eq!(response, ack(1)),
        }
    }
    assert!(busy >= 2, "{busy}");
    assert_eq!(firmware.unfinished(), Some(PACKET));
    // While a packet is written the MainDevice leaves Boot.
    send(&mut rig, DATA, 2, &content(PACKET));
    assert_eq!(rig.request(INIT), (INIT, 0));
    rig.pass(2_000);
    assert_eq!((firmware.taken().len(), firmware.unfinished(), restarts.0.get()), (0, None, 0));
    // And begins anew.
    firmware.set_pace(Duration::from_ticks(0));
    rig.bring_to(BOOT);
    assert_eq!(write(&mut rig, "firmware.mgu", 0, &content(700), PACKET), None);
    assert_eq!(firmware.taken(), [content(700)]);
}

#[test]
fn pysoem_writes_new_firmware_as_the_documentation_says() {
    let test = "gateway::firmware::pysoem_writes_new_firmware_as_the_documentation_says";
    in_own_network(test, || {
        let line = line_of(updatable_device(false));
        let (esc, mut interrupt) = direct(line.borrow().chip(0));
        let (place, buffer) = (EthercatState::new(), FileBuffer::new());
        let objects = GatewayObjects::new(&place).with_files(&buffer);
        let mut sub_device = SubDevice::new(updatable_device(false), esc, objects);
        let (firmware, restarts) = (Firmware::default(), Restarts::default());
        firmware.set_pace(Duration::from_millis(1));
        let socket = PacketSocket::open(SEGMENT_END).unwrap();
        let document = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/firmware.md");
        let mut script = start_master("firmware.py", &[document.to_owned(), "20000".to_owned()]);
        let device = sub_device.run(async || interrupt.wait_for_high().await.unwrap());
        let owner = owner(&buffer, firmware.clone(), restarts.clone());
        let all = select(select(device, owner), ends_well(&mut script));
        assert!(matches!(serve(&socket, &line, all).unwrap(), Either::Second(())));
        assert_eq!(firmware.taken().iter().map(Vec::len).collect::<Vec<_>>(), [20_000]);
        assert_eq!(restarts.0.get(), 1);
    });
}
