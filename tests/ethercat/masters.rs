//! A real MainDevice on the gateway's description: ethercrab, in process and in virtual time.

use ethercat_subdevice::lan9252::Lan9252 as Driver;
use ethercrab::error::CoeAbortCode;
use mobgate_simulator::lan9252::over_spi;
use mobgate_simulator::sub_device::{exchange_images, start_up};

use crate::esc_masters::Capture;
use crate::prelude::*;

#[test]
fn ethercrab_brings_the_gateway_to_op_with_its_default_mapping() {
    let started = start_up(&GATEWAY, direct).unwrap();
    assert!(started.round_trips >= 2 * (15 + 3), "each mapped entry is asked for: {started:?}");
    assert!(started.time.as_millis() <= 300, "{started:?}");
}

#[test]
fn ethercrab_brings_it_to_op_over_spi_at_20_mhz_in_300_ms() {
    let started = start_up(&GATEWAY, over_spi).unwrap();
    println!("{} ms, {} mailbox requests", started.time.as_millis(), started.round_trips);
    assert!(started.time.as_millis() <= 300, "{started:?}");
}

#[test]
fn statement_53_a_start_over_spi_misuses_the_chip_nowhere() {
    let mut used = None;
    let reach = |chip| {
        let lan9252 = Lan9252::new(chip, Timing::USUAL);
        used = Some(lan9252.clone());
        (Driver::new(lan9252.spi(), Wiring::default()), lan9252.interrupt())
    };
    start_up(&GATEWAY, reach).unwrap();
    used.unwrap().check();
}

#[test]
fn ethercrab_exchanges_120_bytes_each_way_without_a_lost_or_torn_image() {
    let exchanged = exchange_images(&GATEWAY, 1_000, 20).unwrap();
    assert_eq!((exchanged.short, exchanged.lost, exchanged.wrong), (0, 0, 0));
}

#[test]
fn ethercrab_reads_and_writes_objects() {
    with_ethercrab(&GATEWAY, gateway_objects(), async |dispatcher| {
        let group = dispatcher.to_pre_op().await.unwrap();
        let device = group.subdevice(dispatcher.master, 0).unwrap();
        assert_eq!(device.name(), "mobgate");
        assert_eq!(device.identity().product_id, GATEWAY.identity.product);
        assert_eq!(device.sdo_read::<u32>(0x1018, 1).await.unwrap(), GATEWAY.identity.vendor);
        let name = device.sdo_read::<[u8; 34]>(0x1008, 0).await.unwrap();
        assert_eq!(name, GATEWAY.name.as_bytes());
        device.sdo_write(0x2001, 1, 17u16).await.unwrap();
        assert_eq!(device.sdo_read::<u16>(0x2001, 1).await.unwrap(), 17);
        let refused = device.sdo_write(0x2001, 1, 248u16).await;
        assert_eq!(abort_code(refused), Some(CoeAbortCode::ValueTooLarge.into()));
    });
}

#[test]
fn ethercrab_goes_up_and_down_many_times() {
    with_ethercrab(&GATEWAY, SharedEcho::default(), async |dispatcher| {
        for number in 1..20 {
            let group = dispatcher.to_pre_op().await.unwrap();
            let group = dispatcher.to_op(group, 10 * number).await.unwrap();
            for more in 1..5 {
                assert_eq!(dispatcher.exchange(&group, 10 * number + more).await.unwrap().1, 3);
                Timer::after_millis(1).await;
            }
            let group = group.into_safe_op(dispatcher.master).await.unwrap();
            group.into_pre_op(dispatcher.master).await.unwrap().into_init(dispatcher.master).await.unwrap();
        }
    });
}

#[test]
fn tshark_decodes_a_start_with_all_its_messages_without_malformed_packets() {
    let capture = Capture::default();
    let mut world = World::new(1);
    let line = line_of(&GATEWAY);
    let (esc, interrupt) = direct(line.borrow().chip(0));
    spawn(&world, SubDevice::new(&GATEWAY, esc, gateway_objects()), interrupt);
    let cable = cable(line).with_capture(capture.pcap());
    with_master(&mut world, cable, async |dispatcher| {
        let group = dispatcher.to_pre_op().await.unwrap();
        group.subdevice(dispatcher.master, 0).unwrap().sdo_write(0x2001, 1, 17u16).await.unwrap();
        dispatcher.to_op(group, 1).await.unwrap();
    });
    let (frames, ethercat, malformed) = capture.decode();
    assert!(frames > 800, "{frames} frames");
    assert_eq!(frames, ethercat, "all of them EtherCAT");
    assert_eq!(malformed, [] as [String; 0]);
}
