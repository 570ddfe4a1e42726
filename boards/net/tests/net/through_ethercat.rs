//! Modbus TCP through EtherCAT's mailboxes (EoE): a device behind the gateway, the gateway behind embassy-net at the SubDevice, and a
//! client behind embassy-net at a MainDevice that exchanges process data in each cycle. All in virtual time.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::net::SocketAddr;
use std::rc::Rc;

use embassy_futures::select::select;
use embassy_net_driver_channel::{RxRunner, TxRunner};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant, Timer};
use embedded_hal_async::digital::Wait;
use embedded_io_async::{Read, Write};
use ethercat_esc::sub_device::{direct, line_of_kind};
use ethercat_esc::{Kind, MainDevice, SharedChip};
use ethercat_subdevice::al_state::AlState;
use ethercat_subdevice::device::Device;
use ethercat_subdevice::eoe::{Eoe, FRAME_BYTES_MAX, Link};
use ethercat_subdevice::foe::NoFiles;
use ethercat_subdevice::sync_manager::Channel;
use mobgate::fieldbus::{EthercatState, long_device, serve_long};
use mobgate::hal::{TcpConnect, TcpHost, TcpStream as _};
use mobgate::settings::TcpListen;
use mobgate_net::{Connector, Sockets, TcpSockets};
use mobgate_simulator::net::Network;
use mobgate_simulator::rig::{Size, machine, with_gateway_on};
use mobgate_simulator::world::Clock;

use super::cable::{FAR, MTU, NEAR, host};

/// The cycle of process data.
const CYCLE: Duration = Duration::from_millis(1);
const PORT_502: TcpListen = TcpListen { address: None, port: 502 };

const SETTINGS: &str = "port P502 tcp server 502
    port plc tcp client 10.0.1.1:502
    port ecat ethercat interface eth1 ethernet eoe0
    route P502 * * * plc";

/// What the MainDevice has seen.
#[derive(Default)]
pub(crate) struct Seen {
    pub(crate) cycles: Cell<u64>,
    /// Cycles whose process data got lost, and those that took longer than a cycle.
    pub(crate) lost: Cell<u64>,
    pub(crate) late: Cell<u64>,
}

/// How transactions fared.
pub(crate) struct Fared {
    pub(crate) a_second: f64,
    pub(crate) wrong: u64,
    pub(crate) seen: Rc<Seen>,
}

fn count(of: &Cell<u64>) {
    of.set(of.get() + 1);
}

#[test]
fn transactions_pass_the_mailboxes_and_disturb_no_cycle() {
    let Fared { a_second, wrong, seen } = transactions(500);
    assert_eq!((wrong, seen.lost.get(), seen.late.get()), (0, 0, 0));
    assert!(a_second > 200.0, "{a_second}");
    assert!(seen.cycles.get() as f64 > 1e3 * 500.0 / a_second, "each cycle has its process data");
}

/// Lets a client read registers of the device so often.
pub(crate) fn transactions(number: u16) -> Fared {
    let size = Size { ethercat: EthercatState::long, ethercat_interfaces: true, ..Size::default() };
    with_gateway_on(Clock::Virtual, size, 1, SETTINGS, |world, rig| {
        rig.attach_tcp(world, "10.0.1.1:502", [mobgate_simulator::Device::new(5)]);
        let device = long_device(false, true);
        let chip = line_of_kind(Kind::IP_CORE, device).borrow().chip(0);
        let ((to_gateway, from_gateway), far) = host(world, FAR, 1, Rc::default());
        let (waiting, arrived) = (Rc::default(), Rc::new(Signal::<NoopRawMutex, ()>::new()));
        world.spawn(take_all(from_gateway, Rc::clone(&waiting), arrived.clone()));
        world.spawn(pass_on(far, rig.network.clone()));
        let (esc, mut interrupt) = direct(chip.clone());
        let ethernet = Eoe::new(Stack { to: to_gateway, waiting });
        let state = rig.gateway.ethercat().unwrap();
        world.spawn(serve_long(state, None, NoFiles, ethernet, esc, None, async move || {
            select(interrupt.wait_for_high(), arrived.wait()).await;
        }));

        let ((to_client, from_client), near) = host(world, NEAR, 1, Rc::default());
        let seen = Rc::new(Seen::default());
        world.spawn(main_device(chip, device, to_client, from_client, seen.clone()));
        let (wrong, time) = world.run_until(read_registers(near, number));
        Fared { a_second: f64::from(number) * 1e6 / time.as_micros() as f64, wrong, seen }
    })
}

/// Reads registers of the device, one request after the other; the number of wrong responses, and the time.
async fn read_registers(near: &'static Sockets, count: u16) -> (u64, Duration) {
    // Until the MainDevice has brought the device to Op.
    Timer::after_secs(1).await;
    let server = SocketAddr::new(FAR.into(), 502).into();
    let mut stream = Connector::new(near).connect(&server).await.expect("the gateway is reached");
    let (start, mut wrong) = (Instant::now(), 0);
    for number in 0..count {
        let [high, low] = number.to_be_bytes();
        let register = (number % 250) as u8;
        stream.write_all(&[high, low, 0, 0, 0, 6, 5, 3, 0, register, 0, 2]).await.unwrap();
        let mut response = [0; 13];
        stream.read_exact(&mut response).await.unwrap();
        let expected = [high, low, 0, 0, 0, 7, 5, 3, 4, 5, register, 5, register + 1];
        wrong += u64::from(response != expected);
    }
    (wrong, start.elapsed())
}

/// Passes connections on to the gateway, whose sockets are those of the simulated network.
async fn pass_on(far: &'static Sockets, network: Network) {
    let mut host = TcpSockets::new(far);
    loop {
        let (mut outside, _) = host.accept(&PORT_502).await.unwrap();
        let mut inside = network.connect(machine(9), 502).expect("the gateway listens");
        let mut bytes = [0; 512];
        // One request at a time is open.
        while let Ok(length @ 1..) = outside.read(&mut bytes).await {
            inside.write_all(&bytes[..length]).await.unwrap();
            let length = inside.read(&mut bytes).await.unwrap();
            outside.write_all(&bytes[..length]).await.unwrap();
        }
        outside.close().await;
    }
}

/// The gateway's network stack, with its frames for the MainDevice.
struct Stack {
    to: RxRunner<'static, MTU>,
    waiting: Rc<RefCell<VecDeque<Vec<u8>>>>,
}

impl Link for Stack {
    fn receive(&mut self, frame: &[u8]) {
        if let Some(buffer) = self.to.try_rx_buf() {
            buffer[..frame.len()].copy_from_slice(frame);
            self.to.rx_done(frame.len());
        }
    }

    fn transmit(&mut self, into: &mut [u8; FRAME_BYTES_MAX]) -> Option<usize> {
        let frame = self.waiting.borrow_mut().pop_front()?;
        into[..frame.len()].copy_from_slice(&frame);
        Some(frame.len())
    }
}

/// Takes the stack's frames, and tells of each.
async fn take_all(
    mut stack: TxRunner<'static, MTU>,
    waiting: Rc<RefCell<VecDeque<Vec<u8>>>>,
    arrived: Rc<Signal<NoopRawMutex, ()>>,
) {
    loop {
        let frame = stack.tx_buf().await.to_vec();
        stack.tx_done();
        waiting.borrow_mut().push_back(frame);
        arrived.signal(());
    }
}

async fn give(stack: &mut RxRunner<'static, MTU>, frame: &[u8]) {
    stack.rx_buf().await[..frame.len()].copy_from_slice(frame);
    stack.rx_done(frame.len());
}

/// A MainDevice with a cycle: process data, a fragment to the device, a fragment from it.
async fn main_device(
    chip: SharedChip,
    device: &'static Device,
    mut to_stack: RxRunner<'static, MTU>,
    mut from_stack: TxRunner<'static, MTU>,
    seen: Rc<Seen>,
) {
    let mut master = MainDevice::new(chip, device);
    Timer::after_millis(100).await;
    master.bring_to(AlState::Op).await.expect("Op");
    let outputs = vec![0; device.default_bytes(Channel::Outputs).into()];
    let mailbox = usize::from(device.memory.mailbox_bytes);
    let (mut waiting, mut arriving) = (VecDeque::new(), Vec::new());
    let (mut frame, mut counter) = (0, 0);
    let mut next = Instant::now();
    loop {
        next += CYCLE;
        count(if master.exchange(&outputs).await.is_ok() { &seen.cycles } else { &seen.lost });
        if waiting.is_empty()
            && let Some(packet) = from_stack.try_tx_buf()
        {
            frame = (frame + 1) % 16;
            waiting.extend(fragments(packet, frame, mailbox));
            from_stack.tx_done();
        }
        if let Some(payload) = waiting.front() {
            let following = counter % 7 + 1;
            let mut message = vec![0; mailbox];
            message[0] = payload.len() as u8;
            message[5] = 2 | following << 4;
            message[6..6 + payload.len()].copy_from_slice(payload);
            // Else the mailbox is full.
            if master.write(device.memory.start(Channel::MailboxOut), &message).await.is_ok() {
                waiting.pop_front();
                counter = following;
            }
        }
        // Else it is empty.
        if let Ok(message) = master.read(device.memory.start(Channel::MailboxIn), mailbox).await {
            assert_eq!(message[5] & 0x0f, 2, "a fragment: {message:02x?}");
            let (fragment, is_last) = (message[8] & 0x3f, message[7] & 1 == 1);
            if fragment == 0 {
                arriving.clear();
            }
            arriving.extend(&message[10..6 + usize::from(message[0])]);
            if is_last {
                give(&mut to_stack, &arriving).await;
            }
        }
        if Instant::now() > next {
            count(&seen.late);
        }
        Timer::at(next).await;
    }
}

/// The fragments of a frame: all but the last have a multiple of 32 bytes.
fn fragments(packet: &[u8], frame: u16, mailbox: usize) -> Vec<Vec<u8>> {
    let most = mailbox - 10;
    let cut = if packet.len() <= most { most } else { most / 32 * 32 };
    let parts = packet.chunks(cut).enumerate();
    let number = packet.chunks(cut).count();
    let fragment = |(nth, part): (usize, &[u8])| {
        let units = if nth == 0 { packet.len().div_ceil(32) } else { nth * cut / 32 };
        let place = nth as u16 | (units as u16) << 6 | frame << 12;
        [&[0, u8::from(nth + 1 == number)][..], &place.to_le_bytes(), part].concat()
    };
    parts.map(fragment).collect()
}
