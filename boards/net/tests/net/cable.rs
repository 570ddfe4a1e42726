//! Two embassy-net stacks at the two ends of a cable that can be pulled, in virtual time.

use std::cell::Cell;
use std::rc::Rc;

use embassy_net::{Config, Ipv4Address, Ipv4Cidr, StackResources, StaticConfigV4};
use embassy_net_driver_channel::driver::{HardwareAddress, LinkState};
use embassy_net_driver_channel::{self as channel, Device, RxRunner, State, TxRunner};
use embassy_time::{Duration, Timer};
use mobgate_net::Sockets;
use mobgate_simulator::World;

const MTU: usize = 1514;
/// Time that a packet is under way.
const LATENCY: Duration = Duration::from_micros(50);

pub(crate) const NEAR: Ipv4Address = Ipv4Address::new(10, 0, 0, 1);
pub(crate) const FAR: Ipv4Address = Ipv4Address::new(10, 0, 0, 2);

/// A cable, and whether it is plugged in.
#[derive(Clone, Default)]
pub(crate) struct Cable {
    pulled: Rc<Cell<bool>>,
}

impl Cable {
    /// Nothing arrives any more. Nobody is told: a switch stands between the two.
    pub(crate) fn pull(&self) {
        self.pulled.set(true);
    }

    pub(crate) fn plug_in(&self) {
        self.pulled.set(false);
    }

    async fn carry(self, mut from: TxRunner<'static, MTU>, mut to: RxRunner<'static, MTU>) {
        loop {
            let packet = from.tx_buf().await.to_vec();
            from.tx_done();
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
    let (near_channel, near) = host(world, NEAR, near);
    let (far_channel, far) = host(world, FAR, far);
    let (near_rx, near_tx) = near_channel;
    let (far_rx, far_tx) = far_channel;
    world.spawn(cable.clone().carry(near_tx, far_rx));
    world.spawn(cable.clone().carry(far_tx, near_rx));
    (near, far, cable)
}

type Ends = (RxRunner<'static, MTU>, TxRunner<'static, MTU>);

fn host(world: &World<'static>, address: Ipv4Address, sockets: usize) -> (Ends, &'static Sockets) {
    let state = Box::leak(Box::new(State::<MTU, 4, 4>::new()));
    let hardware = HardwareAddress::Ethernet([2, 0, 0, 0, 0, address.octets()[3]]);
    let (ends, device): (_, Device<'static, MTU>) = channel::new(state, hardware);
    let (link, rx, tx) = ends.split();
    link.set_link_state(LinkState::Up);
    let config = StaticConfigV4 {
        address: Ipv4Cidr::new(address, 24),
        gateway: None,
        dns_servers: Default::default(),
    };
    let resources = Box::leak(Box::new(StackResources::<32>::new()));
    let (stack, mut runner) = embassy_net::new(device, Config::ipv4_static(config), resources, 7);
    world.spawn(async move { runner.run().await });
    let buffers = (0..sockets).map(|_| &mut *Vec::leak(vec![0; 2048]));
    let sockets: &'static Sockets = Box::leak(Box::new(Sockets::new(stack, buffers)));
    world.spawn(sockets.run());
    ((rx, tx), sockets)
}
