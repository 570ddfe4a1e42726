//! Data points by SDO (2040h to 2043h): a MainDevice starts what a master of the own unit starts by its registers.

use std::net::Ipv4Addr;

use mobgate_simulator::Device;
use mobgate_simulator::client::Response;

use super::bench::with_rig;
use crate::prelude::*;

const SETTINGS: &str = "port bus serial uart1 rtu client 19200 8E1 timeout 100ms
    port ecat ethercat
    port scan scanner
    port P502 tcp server 502
    route ecat 1-247 * * bus
    route scan 1-247 * * bus
    route P502 248 * * local
    device meter unit 7
    point di meter holding 0 read manual
    point ao meter holding 100 count 2 read manual
    point fixed meter input 0 read manual
    point set local holding 100 of ao";

fn aborted(result: Result<(), Error>, abort: Abort) {
    assert_eq!(abort_code(result), Some(abort as u32), "{abort:?}");
}

#[test]
fn a_main_device_has_points_read_and_written_and_sees_what_came_of_it() {
    let device = Device::new(7);
    with_rig(19_200, SETTINGS, vec![device.clone()], async |dispatcher, rig| {
        let group = dispatcher.to_pre_op().await.unwrap();
        let gateway = group.subdevice(dispatcher.master, 0).unwrap();
        let mut plc = rig.client(Ipv4Addr::LOCALHOST.into(), 502);
        let read = async |index, sub| gateway.sdo_read::<u16>(index, sub).await.unwrap();
        let write = async |index, sub, value: u16| gateway.sdo_write(index, sub, value).await;
        // MdbmRead: point 0 for requester 1.
        write(0x2040, 1, 0x0101).await.unwrap();
        assert_eq!(read(0x2040, 1).await, 0x0101, "under way");
        Timer::after_millis(100).await;
        assert_eq!((read(0x2040, 1).await, read(0x2041, 1).await), (0x0102, 0x0002));
        // MdbmWrBeg; what a master does with it meanwhile is refused, and it sees whose it is; MdbmWrFin.
        write(0x2040, 2, 0x0103).await.unwrap();
        assert_eq!(read(0x2041, 2).await, 0x0100, "blocked");
        assert_eq!(plc.request(248, &[6, 0xf0, 1, 2, 4]).await.exception(), Some(6));
        assert_eq!(plc.request(248, &[3, 0xf0, 1, 0, 1]).await, Response::Pdu(vec![3, 2, 1, 4]));
        let set = [16, 0, 100, 0, 2, 4, 0, 7, 0, 8];
        assert_eq!(plc.request(248, &set).await, Response::Pdu(set[..5].to_vec()));
        write(0x2040, 2, 0x0104).await.unwrap();
        Timer::after_millis(100).await;
        assert_eq!(read(0x2040, 2).await, 0x0102);
        assert_eq!(device.memory().holding[100..102], [7, 8]);
        // MdbmMark: all holding registers.
        for (sub, value) in (1..).zip([0x0100, 3, 0, 200]) {
            write(0x2042, sub, value).await.unwrap();
        }
        assert_eq!(read(0x2043, 2).await, 0x0200, "two points are under way");
        Timer::after_millis(200).await;
        assert_eq!(read(0x2043, 2).await, 0);
        assert_eq!(device.writes().len(), 1);
    });
}

#[test]
fn what_is_no_command_is_aborted() {
    with_rig(19_200, SETTINGS, vec![Device::new(7)], async |dispatcher, rig| {
        let group = dispatcher.to_pre_op().await.unwrap();
        let gateway = group.subdevice(dispatcher.master, 0).unwrap();
        let write = async |index, sub, value: u16| gateway.sdo_write(index, sub, value).await;
        let mut plc = rig.client(Ipv4Addr::LOCALHOST.into(), 502);
        aborted(write(0x2040, 5, 0x0101).await, Abort::NoEntry);
        aborted(write(0x2040, 1, 0x0105).await, Abort::Range);
        aborted(write(0x2040, 1, 0x2001).await, Abort::Range);
        aborted(write(0x2040, 3, 0x0102).await, Abort::Range);
        aborted(write(0x2040, 1, 0x0104).await, Abort::Range);
        plc.request(248, &[6, 0xf0, 0, 2, 3]).await;
        aborted(write(0x2040, 1, 0x0101).await, Abort::State);
        for (sub, value) in (1..=3).zip([0x0101, 3, 0]) {
            write(0x2042, sub, value).await.unwrap();
        }
        aborted(write(0x2042, 4, 1).await, Abort::NoEntry);
        write(0x2042, 1, 0x0100).await.unwrap();
        aborted(write(0x2042, 4, 1).await, Abort::State);
        assert_eq!(gateway.sdo_read::<u16>(0x2040, 1).await.unwrap(), 0x0204, "nothing was taken");
        assert_eq!(gateway.sdo_read::<u16>(0x2040, 128).await.unwrap(), 0, "there is no such point");
        // The next one is told what came of itself.
        write(0x2040, 2, 0x0101).await.unwrap();
    });
}
