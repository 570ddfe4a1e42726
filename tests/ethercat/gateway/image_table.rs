//! The process image in the tables of the gateway's own unit, for clients that are no MainDevice.

use std::net::Ipv4Addr;

use mobgate_simulator::Device;
use mobgate_simulator::client::Response;
use mobgate_simulator::console::typed;

use super::bench::with_rig;
use crate::prelude::*;

const SETTINGS: &str = "port bus serial uart1 rtu client 19200 8E1 timeout 100ms
    port ecat ethercat
    port P502 tcp server 502
    route ecat 1-247 * * bus
    route P502 100 * * local
    slave 0 unit 7 holding 100 count 2 read 100ms
    slave 1 unit 9 holding 0 count 1 read 100ms";

#[test]
fn a_client_reads_the_process_image_with_state_and_age_from_the_own_unit() {
    let device = Device::new(7);
    device.memory().holding[100..102].copy_from_slice(&[0x0102, 0x0304]);
    with_rig(19_200, SETTINGS, vec![device.clone()], async |_, rig| {
        let mut client = rig.client(Ipv4Addr::LOCALHOST.into(), 502);
        let mut read = async |address: u16, count: u8| {
            let [high, low] = address.to_be_bytes();
            let Response::Pdu(pdu) = client.request(100, &[4, high, low, 0, count]).await else {
                panic!("no response")
            };
            let words = || pdu[2..].chunks(2).map(|word| u16::from_be_bytes([word[0], word[1]])).collect();
            (pdu[0] == 4).then(words)
        };
        Timer::after_secs(1).await;
        let image: Vec<u16> = read(0xe000, 3).await.unwrap();
        let expected = [0x0102, 0x0304, 0];
        assert_eq!(image, expected, "two registers of the one, one of the other, which never answered");
        let shown = typed(rig.gateway, "show image\n").await;
        assert_eq!(
            shown,
            " NO UNIT IMAGE   TABLE    ADDRESS VALUES\n  \
             0    7 inputs  holding      100 258 772\n  \
             0    7 outputs holding      100 0 0\n  \
             1    9 inputs  holding        0 0\n  \
             1    9 outputs holding        0 0\n"
        );
        assert_eq!(read(0xe200, 2).await, Some(vec![0, 0]), "no MainDevice has given outputs");
        let states = read(0xe400, 6).await.unwrap();
        assert_eq!(states[0] & 3, 1, "well");
        assert!(states[1] <= 2, "{} tenths of a second old", states[1]);
        assert_eq!((states[2] & 3, states[3]), (2, 65_535), "silent, and never heard of");
        assert_eq!(states[4..], [0, 65_535], "there is no third");
        device.set_faults(Faults::new(1).with(When::Always, Fault::Dead));
        Timer::after(Duration::from_secs(3)).await;
        let states = read(0xe400, 2).await.unwrap();
        assert_eq!(states[0] & 3, 2, "silent");
        assert!((25..=31).contains(&states[1]), "{} tenths of a second old", states[1]);
        assert_eq!(read(0xe100, 1).await, None, "nothing is between inputs and outputs");
    });
}
