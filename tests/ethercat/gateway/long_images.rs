//! More slaves than four, and images longer than 120 bytes, by PDOs that are assigned.

use ethercrab::subdevice_group::PreOp;
use mobgate_simulator::Device;

use super::bench::{MS, cycle_for, to_op, with_long_wire, with_wire};
use crate::prelude::*;

const SETTINGS: &str = "port bus serial uart1 rtu client 115200 8E1
    port ecat ethercat
    route ecat 1-247 * * bus";
const SLAVES: u16 = 32;
const BAUD: u32 = 115_200;

fn devices() -> Vec<Device> {
    (1..=SLAVES as u8).map(Device::new).collect()
}

/// Sub-indices and values that are the same in each slave: 32 coils and six holding registers are 16 bytes each way.
const SHORT: &[(u8, u16)] = &[(2, 32), (3, 0), (8, 6), (9, 0)];

/// `slaves` of these cells each.
async fn configure<const BYTES: usize>(
    dispatcher: &Dispatcher<'_>,
    group: &Group<PreOp, BYTES>,
    slaves: u16,
    cells: impl Fn(u16) -> &'static [(u8, u16)],
) -> Result<(), Error> {
    let gateway = group.subdevice(dispatcher.master, 0).unwrap();
    gateway.sdo_write(0x2000, 1, slaves).await?;
    for nth in 0..slaves {
        gateway.sdo_write(0x2100 + nth, 1, nth + 1).await?;
        for (sub, value) in cells(nth) {
            gateway.sdo_write(0x2100 + nth, *sub, *value).await?;
        }
        gateway.sdo_write(0x2100 + nth, 10, 500_u32).await?;
    }
    gateway.sdo_write(0x2005, 1, 1_u16).await
}

async fn assign(dispatcher: &Dispatcher<'_>, group: &Group<PreOp>, outputs: &[u16], inputs: &[u16]) {
    let gateway = group.subdevice(dispatcher.master, 0).unwrap();
    gateway.sdo_write_array(0x1c12, outputs).await.unwrap();
    gateway.sdo_write_array(0x1c13, inputs).await.unwrap();
}

#[test]
fn thirty_two_slaves_exchange_512_bytes_each_way() {
    with_wire(BAUD, SETTINGS, devices(), async |dispatcher, gateway| {
        let group = dispatcher.to_pre_op().await.unwrap();
        assign(&dispatcher, &group, &[0x1601, 0x1602, 0x1603], &[0x1a01, 0x1a04, 0x1a05, 0x1a06]).await;
        configure(&dispatcher, &group, SLAVES, |_| SHORT).await.unwrap();
        let device = group.subdevice(dispatcher.master, 0).unwrap();
        let last = device.sdo_read::<u16>(0x2140 + 31, 6).await.unwrap();
        assert_eq!(last, 511, "the last input byte");
        let image: Vec<u8> = (0..512_usize).map(|byte| (byte * 7 % 251) as u8).collect();
        let group = to_op(&dispatcher, group, &image, 2 * MS).await;
        cycle_for(&dispatcher, &group, 3_000 * MS, 2 * MS).await;
        let device = group.subdevice(dispatcher.master, 0).unwrap();
        assert_eq!((device.outputs_raw().len(), device.inputs_raw().len()), (512, 512 + 64));
        assert_eq!(device.inputs_raw()[..512], image, "every byte is read back");
        let states = device.inputs_raw()[512..].to_vec();
        for (nth, state) in states.as_chunks::<2>().0.iter().enumerate() {
            assert_eq!((state[0] & 0x7f, state[1]), (1, 0), "slave {nth} is well");
            let responses = gateway.ethercat().unwrap().slave_status(nth).unwrap().responses;
            assert!(responses > 5, "slave {nth}: {responses}");
            assert_eq!(device.sdo_read::<u8>(0x2180 + nth as u16, 1).await.unwrap(), 1);
        }
    });
}

#[test]
fn an_image_longer_than_the_assigned_pdos_is_refused_where_it_is_found() {
    with_wire(BAUD, SETTINGS, devices(), async |dispatcher, gateway| {
        let place = gateway.ethercat().unwrap();
        let group = dispatcher.to_pre_op().await.unwrap();
        // 120 bytes each way.
        assert!(configure(&dispatcher, &group, SLAVES, |_| SHORT).await.is_err());
        assert!(!place.is_running());
        let device = group.subdevice(dispatcher.master, 0).unwrap();
        let reason = device.sdo_read::<[u8; 48]>(0x2006, 0).await.unwrap();
        assert!(reason.starts_with(b"slave 7 ends past the 120 input bytes"), "{}", reason.escape_ascii());

        // With room it is taken over; then the room is taken away.
        assign(&dispatcher, &group, &[0x1600, 0x1602, 0x1603], &[0x1a00, 0x1a04, 0x1a05]).await;
        group.subdevice(dispatcher.master, 0).unwrap().sdo_write(0x2005, 1, 1_u16).await.unwrap();
        assert!(place.is_running());
        assign(&dispatcher, &group, &[0x1600, 0x1602, 0x1603], &[0x1a00, 0x1a04]).await;
        assert!(group.into_safe_op(dispatcher.master).await.is_err());
        assert!(place.is_running(), "which is the state's fault, not the configuration's");
    });
}

/// All PDOs of outputs, and of inputs, of long images.
const LONG_OUTPUTS: [u16; 4] = [0x1601, 0x1604, 0x1605, 0x1606];
const LONG_INPUTS: [u16; 4] = [0x1a01, 0x1a07, 0x1a08, 0x1a09];

/// Each slave has 24 holding registers, the last one 23: 1486 bytes each way.
fn long(nth: u16) -> &'static [(u8, u16)] {
    if nth == 30 { &[(8, 23)] } else { &[(8, 24)] }
}

#[test]
fn what_the_controllers_memory_does_not_hold_is_refused_with_its_reason() {
    // 8 KiB hold 1500 bytes of outputs three times, and 1144 of inputs behind them; 4 KiB hold no inputs there.
    for (kind, taken, reason) in [
        (Kind::ET1100, 3, "slave 21 ends past the 1020 input bytes"),
        (Kind::LAN9252, 0, "slave 0 ends past the 0 input bytes"),
    ] {
        with_long_wire(kind, BAUD, SETTINGS, devices(), async |dispatcher, gateway| {
            let group = dispatcher.to_pre_op_with::<3072>().await.unwrap();
            let device = group.subdevice(dispatcher.master, 0).unwrap();
            // 4 KiB hold 1280 bytes of outputs.
            let outputs = if taken > 0 { LONG_OUTPUTS.len() } else { 3 };
            device.sdo_write_array(0x1c12, &LONG_OUTPUTS[..outputs]).await.unwrap();
            for more in taken + 1..=LONG_INPUTS.len() {
                let outcome = device.sdo_write_array(0x1c13, &LONG_INPUTS[..more]).await;
                assert_eq!(abort_code(outcome), Some(0x0604_0042), "{more} PDOs of inputs");
            }
            if taken > 0 {
                device.sdo_write_array(0x1c13, &LONG_INPUTS[..taken]).await.unwrap();
            }
            assert!(configure(&dispatcher, &group, 31, long).await.is_err());
            assert!(!gateway.ethercat().unwrap().is_running());
            let told = device.sdo_read::<[u8; 48]>(0x2006, 0).await.unwrap();
            assert!(told.starts_with(reason.as_bytes()), "{}", told.escape_ascii());
        });
    }
}

#[test]
fn thirty_one_slaves_exchange_1486_bytes_behind_a_controller_with_the_memory() {
    with_long_wire(Kind::IP_CORE, BAUD, SETTINGS, devices(), async |dispatcher, _| {
        let group = dispatcher.to_pre_op_with::<3072>().await.unwrap();
        let device = group.subdevice(dispatcher.master, 0).unwrap();
        device.sdo_write_array(0x1c12, LONG_OUTPUTS).await.unwrap();
        device.sdo_write_array(0x1c13, LONG_INPUTS).await.unwrap();
        configure(&dispatcher, &group, 31, long).await.unwrap();
        let image: Vec<u8> = (0..1_500_usize).map(|byte| (byte * 7 % 251) as u8).collect();
        let group = to_op(&dispatcher, group, &image, 4 * MS).await;
        cycle_for(&dispatcher, &group, 4_000 * MS, 4 * MS).await;
        let device = group.subdevice(dispatcher.master, 0).unwrap();
        assert_eq!((device.outputs_raw().len(), device.inputs_raw().len()), (1_500, 1_486));
        assert_eq!(device.inputs_raw()[..], image[..1_486], "every byte is read back");
        // The same by SDO, where an object has only a part of it.
        assert_eq!(device.sdo_read::<[u8; 8]>(0x2023, 64).await.unwrap(), image[504..512]);
        for (index, sub, first) in
            [(0x2025, 1, 0), (0x2025, 49, 1_440), (0x2026, 18, 510), (0x2026, 50, 1_470)]
        {
            let bytes = device.sdo_read::<[u8; 30]>(index, sub).await.unwrap();
            assert_eq!(bytes, image[first..first + 30], "{index:x}:{sub}");
        }
        assert_eq!(device.sdo_read::<[u8; 16]>(0x2027, 0).await.unwrap(), image[1_470..1_486]);
    });
}

/// 128 registers: more than one frame reads, so that a value must not be torn between two.
#[test]
fn values_of_32_bits_stand_with_the_high_byte_first_whatever_order_their_device_has() {
    let settings = format!("{SETTINGS}\nslave 0 unit 1 holding 0 count 64 as u32 order 2301 read 100ms");
    let device = Device::new(1);
    with_wire(BAUD, &settings, vec![device.clone()], async |dispatcher, _| {
        let group = dispatcher.to_pre_op().await.unwrap();
        assign(&dispatcher, &group, &[0x1601, 0x1602, 0x1603], &[0x1a01, 0x1a04, 0x1a05]).await;
        let values = (0..64_u32).map(|nth| 0x0102_0304 * (nth + 1));
        let image: Vec<u8> = values.clone().flat_map(u32::to_be_bytes).collect();
        let group = to_op(&dispatcher, group, &image, 2 * MS).await;
        cycle_for(&dispatcher, &group, 1_000 * MS, 2 * MS).await;
        for (nth, value) in values.enumerate() {
            let words = [value as u16, (value >> 16) as u16];
            let read = device.memory().holding[2 * nth..2 * nth + 2].to_vec();
            assert_eq!(read, words, "value {nth}: the low word first");
        }
        assert_eq!(group.subdevice(dispatcher.master, 0).unwrap().inputs_raw()[..256], image);
    });
}
