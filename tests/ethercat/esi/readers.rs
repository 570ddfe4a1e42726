//! The gateway's ESI file in readers by others: the crate ethercat-esi, and the one in Python that ethercat-mcp has.

use std::process::Command;

use ethercat_esi::{EtherCatInfo, Pdo};
use ethercat_subdevice::device::Identity;
use ethercat_subdevice::object::{Access, Entries, PADDING};
use mobgate_simulator::own_network::python;

use super::*;

/// What a reader is to find of a PDO: index, name, SyncManager, and a line for each entry.
fn pdos(device: &Device, channel: Channel) -> Vec<String> {
    let mut lines = Vec::new();
    for pdo in device.described_pdos(channel) {
        let manager = if device.is_assigned(channel, pdo.index) { Some(channel as u8) } else { None };
        lines.push(pdo_line(pdo.index, pdo.name, manager));
        lines.extend(pdo.mapped().map(|mapped| {
            let (index, sub, bits) = ((mapped >> 16) as u16, (mapped >> 8) as u8, mapped as u8);
            let entry =
                device.object(index).filter(|_| index != PADDING).and_then(|object| object.entry(sub));
            let name = entry.map_or(String::new(), |entry| entry.label().to_string());
            entry_line(index, sub, bits.into(), &name)
        }));
    }
    lines
}

fn pdo_line(index: u16, name: &str, manager: Option<u8>) -> String {
    format!("PDO {index:04X} {name}, SyncManager {manager:?}")
}

fn entry_line(index: u16, sub: u8, bits: usize, name: &str) -> String {
    format!("{index:04X}:{sub:02X} {bits} {name}")
}

#[test]
fn the_crate_ethercat_esi_reads_each_device_and_module() {
    // It wants a SyncManager of each PDO, also of one that is not assigned by default.
    let unassigned = |file: String, kind: &str, manager: u8| {
        file.replace(&format!("<{kind} Fixed=\"1\">"), &format!("<{kind} Fixed=\"1\" Sm=\"{manager}\">"))
    };
    let file = unassigned(unassigned(file_of_gateway(), "RxPdo", 2), "TxPdo", 3);
    let read = EtherCatInfo::from_xml_str(&file).unwrap();
    assert_eq!((read.vendor.id, read.vendor.name.as_deref()), (MODULAR.identity.vendor, Some("mobgate")));
    assert_eq!(read.description.devices.len(), devices().len());
    for (found, device) in read.description.devices.iter().zip(devices()) {
        assert_eq!(found.name, device.name);
        assert_eq!(
            (found.product_code, found.revision_no),
            (device.identity.product, device.identity.revision)
        );
        let managers: Vec<_> = found.sm.iter().map(|sm| (sm.start_address, sm.control_byte)).collect();
        let inputs = if device.memory.inputs_bytes_max > 1_000 { 0x2298 } else { 0x1700 };
        assert_eq!(managers, [(0x1000, 0x26), (0x1080, 0x22), (0x1100, 0x64), (inputs, 0x20)]);
        for (channel, found) in [(Channel::Outputs, &found.rx_pdo), (Channel::Inputs, &found.tx_pdo)] {
            let expected: Vec<_> = pdos(device, channel)
                .into_iter()
                .map(|line| line.replace("SyncManager None", &format!("SyncManager Some({})", channel as u8)))
                .collect();
            assert_eq!(found.iter().flat_map(lines).collect::<Vec<_>>(), expected, "{}", device.name);
        }
    }
    let module = &read.description.modules[0];
    assert_eq!(
        module.name.as_deref(),
        Some(
            "Slave 0, unit 17: 10 discrete inputs, 3 coils, 4 REAL in input registers, 3 INT in holding registers"
        )
    );
    let outputs = module.rx_pdo.as_ref().unwrap();
    assert_eq!(
        lines(outputs),
        [
            "PDO 1600 Outputs of module, SyncManager Some(2)",
            "7000:01 1 Coil 1",
            "7000:02 1 Coil 2",
            "7000:03 1 Coil 3",
            "0000:00 13 ",
            "7001:01 16 Holding register 1",
            "7001:02 16 Holding register 2",
            "7001:03 16 Holding register 3",
        ]
    );
    let types = module.tx_pdo.as_ref().unwrap().entries.iter().map(|entry| entry.data_type.as_deref());
    assert_eq!(types.filter(|found| *found == Some("REAL")).count(), 4);
}

/// What ethercat-esi has read of a PDO.
fn lines(pdo: &Pdo) -> Vec<String> {
    let first = pdo_line(pdo.idx.into(), pdo.name.as_deref().unwrap_or_default(), Some(u8::from(pdo.sm)));
    let entries = pdo.entries.iter().map(|entry| {
        let at = &entry.entry_idx;
        entry_line(at.idx.into(), at.sub_idx.into(), entry.bit_len, entry.name.as_deref().unwrap_or_default())
    });
    [first].into_iter().chain(entries).collect()
}

#[test]
fn the_reader_of_ethercat_mcp_finds_each_pdo_and_each_object() {
    let file = std::env::temp_dir().join(format!("mobgate-{}.xml", std::process::id()));
    std::fs::write(&file, file_of_gateway()).unwrap();
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/ethercat/esi/reader.py");
    let read = Command::new(python("ethercat_mcp.esi_parser")).arg(script).arg(&file).output().unwrap();
    std::fs::remove_file(&file).unwrap();
    assert!(read.status.success(), "{}", String::from_utf8_lossy(&read.stderr));
    let read = String::from_utf8(read.stdout).unwrap();

    let mut expected = vec![format!("vendor {:08X} mobgate", MODULAR.identity.vendor)];
    for device in devices() {
        let Identity { product, revision, .. } = device.identity;
        expected.push(format!("device {} {product:08X} {revision:08X}", device.name));
        expected.extend([Channel::Outputs, Channel::Inputs].map(|channel| pdos(device, channel)).concat());
        expected.extend(device.objects.iter().flat_map(object_lines));
    }
    assert_eq!(read.lines().collect::<Vec<_>>(), expected);
}

/// What a reader is to find of an object: index, name, and a line for each entry of a record.
fn object_lines(object: &Object) -> Vec<String> {
    let mut lines = vec![format!("object {:04X} {}", object.index, object.name)];
    if matches!(object.entries, Entries::Record(_)) {
        lines.extend((1..=object.sub_max()).filter_map(|sub| Some((sub, object.entry(sub)?))).map(
            |(sub, entry)| {
                let access = match (entry.access.any(Access::READ), entry.access.any(Access::WRITE)) {
                    (_, false) => "ro",
                    (true, true) => "rw",
                    (false, true) => "wo",
                };
                format!(
                    "{} {access}",
                    entry_line(object.index, sub, entry.data_type.bits().into(), &entry.label().to_string())
                )
            },
        ));
    }
    lines
}
