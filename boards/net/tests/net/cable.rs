//! Two embassy-net stacks at the two ends of a cable that can be pulled, in virtual time.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::future::{Future, poll_fn};
use std::pin::pin;
use std::rc::Rc;
use std::task::Poll;

use embassy_net::{Config, Ipv4Address, Ipv4Cidr, StackResources, StaticConfigV4};
use embassy_net_driver_channel::driver::{HardwareAddress, LinkState};
use embassy_net_driver_channel::{self as channel, Device, RxRunner, State, TxRunner};
use embassy_time::{Duration, Timer};
use mobgate_net::{Backlog, Queued, Sockets};
use mobgate_simulator::World;
use smoltcp::phy::ChecksumCapabilities;
use smoltcp::wire::{
    EthernetAddress, EthernetFrame, EthernetProtocol, EthernetRepr, IpProtocol, Ipv4Packet, Ipv4Repr,
    TcpControl, TcpPacket, TcpRepr, TcpSeqNumber,
};

pub(crate) const MTU: usize = 1514;
/// Packets that a host's controller has room for.
const PACKETS: usize = 32;
/// A busy host looks after its packets so often.
const BUSY: Duration = Duration::from_millis(20);
/// Time that a packet is under way.
const LATENCY: Duration = Duration::from_micros(50);

pub(crate) const NEAR: Ipv4Address = Ipv4Address::new(10, 0, 0, 1);
pub(crate) const FAR: Ipv4Address = Ipv4Address::new(10, 0, 0, 2);

/// A cable, whether it is plugged in, and what else sends to its far end.
#[derive(Clone, Default)]
pub(crate) struct Cable {
    pulled: Rc<Cell<bool>>,
    far_is_busy: Rc<Cell<bool>>,
    forged: Rc<RefCell<VecDeque<Vec<u8>>>>,
}

impl Cable {
    /// Nothing arrives any more. Nobody is told: a switch stands between the two.
    pub(crate) fn pull(&self) {
        self.pulled.set(true);
    }

    pub(crate) fn plug_in(&self) {
        self.pulled.set(false);
    }

    /// What the far host receives waits from now on.
    pub(crate) fn keep_far_busy(&self) {
        self.far_is_busy.set(true);
    }

    /// A SYN for the far end, behind the next packet. Who sends it never responds.
    pub(crate) fn forge(&self, from: Ipv4Address, from_port: u16, port: u16) {
        self.forged.borrow_mut().push_back(syn(from, from_port, port));
    }

    async fn carry(
        self,
        mut from: TxRunner<'static, MTU>,
        mut to: RxRunner<'static, MTU>,
        forged: Rc<RefCell<VecDeque<Vec<u8>>>>,
    ) {
        loop {
            let packet = forged.borrow_mut().pop_front();
            let packet = match packet {
                Some(packet) => packet,
                None => {
                    let packet = from.tx_buf().await.to_vec();
                    from.tx_done();
                    packet
                }
            };
            Timer::after(LATENCY).await;
            if !self.pulled.get() {
                to.rx_buf().await[..packet.len()].copy_from_slice(&packet);
                to.rx_done(packet.len());
            }
        }
    }
}

/// Two pools of `near` and `far` sockets with a cable between them.
pub(crate) fn wired(
    world: &World<'static>,
    near: usize,
    far: usize,
) -> (&'static Sockets, &'static Sockets, Cable) {
    let cable = Cable::default();
    let (near_channel, near) = host(world, NEAR, near, Rc::default());
    let (far_channel, far) = host(world, FAR, far, cable.far_is_busy.clone());
    let (near_rx, near_tx) = near_channel;
    let (far_rx, far_tx) = far_channel;
    world.spawn(cable.clone().carry(near_tx, far_rx, cable.forged.clone()));
    world.spawn(cable.clone().carry(far_tx, near_rx, Rc::default()));
    (near, far, cable)
}

type Ends = (RxRunner<'static, MTU>, TxRunner<'static, MTU>);

/// A host with a pool of sockets, and the end of its cable.
pub(crate) fn host(
    world: &World<'_>,
    address: Ipv4Address,
    sockets: usize,
    is_busy: Rc<Cell<bool>>,
) -> (Ends, &'static Sockets) {
    let state = Box::leak(Box::new(State::<MTU, PACKETS, PACKETS>::new()));
    let (ends, device): (_, Device<'static, MTU>) =
        channel::new(state, HardwareAddress::Ethernet(hardware(address)));
    let (link, rx, tx) = ends.split();
    link.set_link_state(LinkState::Up);
    let resources = Box::leak(Box::new(StackResources::<32>::new()));
    let backlog: &'static Backlog = Box::leak(Box::new(Backlog::new()));
    let (stack, mut runner) =
        embassy_net::new(Queued::new(device, backlog), Config::ipv4_static(at(address)), resources, 7);
    world.spawn(async move {
        let mut run = pin!(runner.run());
        loop {
            poll_fn(|context| {
                let _ = run.as_mut().poll(context);
                if is_busy.get() { Poll::Ready(()) } else { Poll::Pending }
            })
            .await;
            Timer::after(BUSY).await;
        }
    });
    let buffers = Vec::leak(vec![[0; 2048]; sockets]);
    let sockets: &'static Sockets = Box::leak(Box::new(Sockets::new(stack, backlog, buffers)));
    world.spawn(sockets.run());
    ((rx, tx), sockets)
}

/// A host's settings.
pub(crate) fn at(address: Ipv4Address) -> StaticConfigV4 {
    StaticConfigV4 { address: Ipv4Cidr::new(address, 24), gateway: None, dns_servers: Default::default() }
}

fn hardware(address: Ipv4Address) -> [u8; 6] {
    [2, 0, 0, 0, 0, address.octets()[3]]
}

/// A SYN for a port of the far host.
fn syn(from: Ipv4Address, src_port: u16, dst_port: u16) -> Vec<u8> {
    let tcp = TcpRepr {
        src_port,
        dst_port,
        control: TcpControl::Syn,
        seq_number: TcpSeqNumber(1),
        ack_number: None,
        window_len: 1024,
        window_scale: None,
        max_seg_size: Some(1460),
        sack_permitted: false,
        sack_ranges: [None; 3],
        timestamp: None,
        payload: &[],
    };
    let ip = Ipv4Repr {
        src_addr: from,
        dst_addr: FAR,
        next_header: IpProtocol::Tcp,
        payload_len: tcp.buffer_len(),
        hop_limit: 64,
    };
    let ethernet = EthernetRepr {
        src_addr: EthernetAddress(hardware(from)),
        dst_addr: EthernetAddress(hardware(FAR)),
        ethertype: EthernetProtocol::Ipv4,
    };
    let checks = ChecksumCapabilities::default();
    let mut frame = vec![0; EthernetFrame::<&[u8]>::buffer_len(ip.buffer_len() + tcp.buffer_len())];
    let mut packet = EthernetFrame::new_unchecked(&mut frame[..]);
    ethernet.emit(&mut packet);
    let mut packet = Ipv4Packet::new_unchecked(packet.payload_mut());
    ip.emit(&mut packet, &checks);
    let mut packet = TcpPacket::new_unchecked(packet.payload_mut());
    tcp.emit(&mut packet, &from.into(), &FAR.into(), &checks);
    frame
}
