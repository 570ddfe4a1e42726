//! What the inputs of a device become when it does not answer any more, and how a MainDevice sees it.

use mobgate_simulator::Device;
use mobgate_simulator::console::typed;

use super::bench::with_wire;
use crate::prelude::*;

const SETTINGS: &str = "port bus serial uart1 rtu client 19200 8E1 timeout 100ms
    port ecat ethercat
    route ecat 1-247 * * bus";
/// Eight coils, of which five are behind the image; two holding registers.
const SLAVE: [(u8, u16); 5] = [(2, 5), (3, 0), (8, 2), (9, 100), (1, 7)];

/// A device dies that had its coils set and 0102h, 0304h in its registers, and comes back later. Its inputs before, while it is
/// silent, and after; and while it is silent the entry 2180h:09, the state's first byte, and its row at the console.
fn inputs(on_silence: u8, substitute: u16) -> ([[u8; 5]; 3], u8, u8, String) {
    let mut outcome = None;
    let device = Device::new(7);
    device.memory().coils[..5].fill(true);
    device.memory().holding[100..102].copy_from_slice(&[0x0102, 0x0304]);
    with_wire(19_200, SETTINGS, vec![device.clone()], async |dispatcher, gateway| {
        let group = dispatcher.to_pre_op().await.unwrap();
        let sub_device = group.subdevice(dispatcher.master, 0).unwrap();
        sub_device.sdo_write(0x2000, 1, 1_u16).await.unwrap();
        for (sub, value) in SLAVE {
            sub_device.sdo_write(0x2001, sub, value).await.unwrap();
        }
        sub_device.sdo_write(0x2001, 10, 100_u32).await.unwrap();
        sub_device.sdo_write(0x2008, 1, on_silence).await.unwrap();
        sub_device.sdo_write(0x2009, 1, substitute).await.unwrap();
        sub_device.sdo_write(0x2005, 1, 1_u16).await.unwrap();
        let place = gateway.ethercat().unwrap();
        let image = || place.inputs(|inputs| inputs[..5].try_into().unwrap());
        Timer::after_secs(1).await;
        let before = image();
        device.set_faults(Faults::new(1).with(When::Always, Fault::Dead));
        Timer::after_secs(2).await;
        let silent = image();
        let inputs_are = sub_device.sdo_read::<u8>(0x2180, 9).await.unwrap();
        let state = sub_device.sdo_read::<u16>(0x2032, 1).await.unwrap() as u8;
        let shown = typed(gateway, "show devices\n").await;
        device.set_faults(Faults::new(1));
        // It is tried again after 15 s.
        Timer::after_secs(16).await;
        let row = shown.lines().nth(1).unwrap().to_owned();
        outcome = Some(([before, silent, image()], inputs_are, state, row));
    });
    outcome.unwrap()
}

const READ: [u8; 5] = [0x1f, 1, 2, 3, 4];
/// Not normal.
const SILENT: u8 = 2;

#[test]
fn the_inputs_of_a_silent_device_are_held() {
    let (images, inputs_are, state, row) = inputs(0, 0xabcd);
    assert_eq!(images, [READ; 3]);
    assert_eq!((inputs_are, state & 0x0f), (1, SILENT | 1 << 2));
    assert!(row.starts_with("slave 0 ") && row.contains("silent, inputs held, tried again in"), "{row}");
}

#[test]
fn the_inputs_of_a_silent_device_are_cleared_until_it_responds() {
    let (images, inputs_are, state, row) = inputs(1, 0xabcd);
    assert_eq!(images, [READ, [0; 5], READ]);
    assert_eq!((inputs_are, state & 0x0f), (2, SILENT | 2 << 2));
    assert!(row.contains("silent, inputs cleared"), "{row}");
}

#[test]
fn the_inputs_of_a_silent_device_are_substituted_until_it_responds() {
    let (images, inputs_are, state, row) = inputs(2, 0xabcd);
    assert_eq!(images, [READ, [0x1f, 0xab, 0xcd, 0xab, 0xcd], READ], "bits take the lowest one");
    assert_eq!((inputs_are, state & 0x0f), (3, SILENT | 3 << 2));
    assert!(row.contains("silent, inputs substituted"), "{row}");
    let (images, ..) = inputs(2, 0x1234);
    assert_eq!(images[1], [0, 0x12, 0x34, 0x12, 0x34]);
}
