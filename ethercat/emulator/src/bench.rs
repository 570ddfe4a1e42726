//! A test bench for SubDevices: a [`Rig`] runs one on an emulated controller and plays the MainDevice, so that a test requests
//! states, messages and process data step by step. Violated preconditions fail the test.
//!
//! A rig runs in virtual time. [`Bench`] is the application of the devices [`MAILBOX_34`] to [`MAILBOX_128`]; for your own device,
//! [`Rig::with_application`] takes your application. A test suite should pass on all of [`CONTROLLERS`].

mod application;
mod controllers;
mod devices;
mod ethernet;
mod files;

use std::cell::RefMut;

use crate::{Command, Interrupt, Kind, Segment, SharedChip};
use embassy_time::{Duration, Instant, Timer};
use ethercat_subdevice::application::Application;
use ethercat_subdevice::device::Device;
use ethercat_subdevice::esc::Esc;
use ethercat_subdevice::sub_device::SubDevice;
use ethercat_subdevice::sync_manager::Channel;
use mobgate_world::World;

use crate::lan9252::Timing;
use crate::main_device::{fmmu, sync_manager};
use crate::sub_device;
use controllers::{PAUSE, POWER_ON, SPI_PAUSE};

pub use application::{Bench, Shared};
pub use controllers::{CHOICE, CONTROLLERS, Controller, lan9252_with};
pub use devices::{
    CLOCKED, CLOCKED_16, ETHERNET_64, ETHERNET_128, FILES_34, FILES_128, LARGE_BYTES, MAILBOX_34, MAILBOX_64,
    MAILBOX_128,
};
pub use ethernet::BenchLink;
pub use files::{BenchFiles, FILE_BYTES_MAX, FIRMWARE, PASSWORD};

/// Init, as coded in AL control and AL status.
pub const INIT: u16 = 1;
/// PreOp, likewise.
pub const PRE_OP: u16 = 2;
/// Boot, likewise.
pub const BOOT: u16 = 3;
/// SafeOp, likewise.
pub const SAFE_OP: u16 = 4;
/// Op, likewise.
pub const OP: u16 = 8;
/// AL status: error indicated; AL control: acknowledge it.
pub const ERROR: u16 = 0x10;

/// Logical address of the process data: outputs, then inputs.
pub const LOGICAL: u32 = 0x0001_0000;

/// Start options of a rig.
pub struct Start {
    /// The controller.
    pub kind: Kind,
    /// Time for the device to react to each frame.
    pub pause: Duration,
    /// The processor latches rising edges of the interrupt instead of sampling its level.
    pub edges: bool,
}

/// A device and its MainDevice.
pub struct Rig<A> {
    /// The segment, for frames that the rig has no method for.
    pub segment: Segment,
    device: &'static Device,
    application: Shared<A>,
    /// Time for the device to react to each frame.
    pub pause: Duration,
    counter: u8,
    /// When process data were last exchanged.
    exchanged: Instant,
    // Declared last so that its tasks are dropped last.
    /// The world that runs the device.
    pub world: World<'static>,
}

impl Controller {
    /// A powered-on device on this controller, with this application.
    pub fn rig<A: Application + 'static>(self, device: &'static Device, application: A) -> Rig<A> {
        let start = Start { kind: self.kind, pause: PAUSE, edges: self.edges };
        match self.spi {
            None => Rig::start(device, application, start, sub_device::direct),
            Some(interrupt) => {
                let start = Start { pause: SPI_PAUSE, ..start };
                let mut rig = Rig::start(device, application, start, |chip| {
                    let (driver, line, _) = lan9252_with(chip, interrupt, Timing::USUAL);
                    (driver, line)
                });
                rig.world.run_for(POWER_ON);
                rig
            }
        }
    }
}

impl Rig<Bench> {
    /// A powered-on device with the bench's application.
    pub fn new(device: &'static Device) -> Self {
        Self::with_application(device, Bench::default())
    }

    /// The same, brought to `state`.
    pub fn in_state(device: &'static Device, state: u16) -> Self {
        let mut rig = Self::new(device);
        rig.bring_to(state);
        rig
    }
}

impl<A: Application + 'static> Rig<A> {
    /// A powered-on device with this application.
    pub fn with_application(device: &'static Device, application: A) -> Self {
        Controller::chosen().rig(device, application)
    }

    /// The same; `reach` makes the processor's access to the chip, which gets `pause` after each frame.
    pub fn reached_by<E: Esc + 'static>(
        device: &'static Device,
        application: A,
        pause: Duration,
        reach: impl FnOnce(SharedChip) -> (E, Interrupt),
    ) -> Self {
        Self::start(device, application, Start { kind: Kind::LAN9252, pause, edges: false }, reach)
    }

    /// The same with all options.
    pub fn start<E: Esc + 'static>(
        device: &'static Device,
        application: A,
        Start { kind, pause, edges }: Start,
        reach: impl FnOnce(SharedChip) -> (E, Interrupt),
    ) -> Self {
        let world = World::new(1);
        let line = sub_device::line_of_kind(kind, device);
        let chip = line.borrow().chip(0);
        let application = Shared::new(application);
        let pins = chip.clone();
        let (esc, interrupt) = reach(chip);
        let signals =
            device.sync_offer().sync0.then(|| sub_device::note_pulses(&world, &pins, Duration::MIN));
        let sub_device = SubDevice::new(device, esc, application.clone()).with_sync(signals);
        match edges {
            false => sub_device::spawn(&world, sub_device, interrupt),
            true => sub_device::spawn_by_edges(&world, sub_device, interrupt),
        }
        let segment = line.replace(Segment::new([]));
        let mut rig =
            Self { segment, device, application, pause, counter: 0, exchanged: Instant::MIN, world };
        rig.pass(1);
        rig
    }

    /// The device's application.
    pub fn application(&self) -> RefMut<'_, A> {
        self.application.0.borrow_mut()
    }

    /// Lets time pass.
    pub fn pass(&mut self, millis: u64) {
        self.world.run_for(Duration::from_millis(millis));
    }

    /// Lets time pass until `millis` after the last exchange of process data.
    pub fn pass_since_exchange(&mut self, millis: u64) {
        self.world.run_until(Timer::at(self.exchanged + Duration::from_millis(millis)));
    }

    /// Writes to the device, then lets it react; returns the working counter.
    pub fn write(&mut self, address: u16, bytes: &[u8]) -> u16 {
        let counter = self.segment.poke(0, address, bytes);
        self.world.run_for(self.pause);
        counter
    }

    /// Reads from the device; `None` without a response.
    pub fn read(&mut self, address: u16, bytes: usize) -> Option<Vec<u8>> {
        let read = self.segment.fetch(0, address, bytes);
        self.world.run_for(self.pause);
        read
    }

    /// AL status and its code, read together.
    pub fn status(&mut self) -> (u16, u16) {
        let bytes = self.read(0x0130, 6).unwrap();
        (u16::from_le_bytes([bytes[0], bytes[1]]), u16::from_le_bytes([bytes[4], bytes[5]]))
    }

    /// Requests a state; returns the resulting status.
    pub fn request(&mut self, control: u16) -> (u16, u16) {
        assert_eq!(self.write(0x0120, &control.to_le_bytes()), 1, "AL control can be written");
        self.status()
    }

    /// The register block that sets a SyncManager up for this device.
    pub fn sync_manager(&self, channel: Channel) -> [u8; 8] {
        sync_manager(self.device, channel)
    }

    /// Sets up SyncManagers for this device.
    pub fn set_up(&mut self, channels: impl IntoIterator<Item = Channel>) {
        for channel in channels {
            let block = self.sync_manager(channel);
            assert_eq!(self.write(channel.registers(), &block), 1);
        }
    }

    /// Sets up both mailboxes.
    pub fn set_up_mailboxes(&mut self) {
        self.set_up([Channel::MailboxOut, Channel::MailboxIn]);
    }

    /// Sets up both SyncManagers of process data, and their FMMUs.
    pub fn set_up_process_data(&mut self) {
        self.set_up([Channel::Outputs, Channel::Inputs]);
        for (register, block) in
            Channel::ALL.into_iter().filter_map(|channel| fmmu(self.device, channel, LOGICAL))
        {
            assert_eq!(self.write(register, &block), 1);
        }
    }

    /// Brings the device from Init to a state, as a MainDevice does.
    pub fn bring_to(&mut self, state: u16) {
        if state >= PRE_OP {
            let first = if state == BOOT { BOOT } else { PRE_OP };
            self.set_up_mailboxes();
            assert_eq!(self.request(first), (first, 0));
        }
        if state >= SAFE_OP {
            self.set_up_process_data();
            assert_eq!(self.request(SAFE_OP), (SAFE_OP, 0));
        }
        if state >= OP {
            self.cycle(0);
            assert_eq!(self.request(OP), (OP, 0));
        }
    }

    /// Exchanges process data in one frame, with all outputs set to `fill`; returns inputs and working counter.
    pub fn cycle(&mut self, fill: u8) -> (Vec<u8>, u16) {
        let outputs = self.device.default_bytes(Channel::Outputs);
        self.exchange(&vec![fill; outputs.into()])
    }

    /// The same with the given outputs.
    pub fn exchange(&mut self, outputs: &[u8]) -> (Vec<u8>, u16) {
        let mut data = outputs.to_vec();
        data.resize(outputs.len() + usize::from(self.device.default_bytes(Channel::Inputs)), 0);
        self.exchanged = Instant::now();
        let response = self.segment.send_logical(Command::Lrw, LOGICAL, &data);
        self.world.run_for(self.pause);
        (response.data[outputs.len()..].to_vec(), response.counter)
    }

    /// Writes a message of a type with a counter; returns the working counter.
    pub fn send_counted(&mut self, protocol: u8, counter: u8, payload: &[u8]) -> u16 {
        let mut message = vec![0xee; self.device.memory.mailbox_bytes.into()];
        message[..2].copy_from_slice(&(payload.len() as u16).to_le_bytes());
        message[2..6].copy_from_slice(&[0, 0, 0, protocol | counter << 4]);
        message[6..6 + payload.len()].copy_from_slice(payload);
        self.write(self.device.memory.start(Channel::MailboxOut), &message)
    }

    /// Writes a CoE message with the next counter.
    pub fn send(&mut self, payload: &[u8]) -> u16 {
        self.counter = self.counter % 7 + 1;
        self.send_counted(3, self.counter, payload)
    }

    /// The message in the mailbox from the device: header and payload, without padding.
    pub fn receive(&mut self) -> Option<Vec<u8>> {
        let bytes = usize::from(self.device.memory.mailbox_bytes);
        let mut message = self.read(self.device.memory.start(Channel::MailboxIn), bytes)?;
        message.truncate(6 + usize::from(u16::from_le_bytes([message[0], message[1]])));
        Some(message)
    }

    /// Sends a CoE request; returns the payload of its response.
    pub fn ask(&mut self, payload: &[u8]) -> Vec<u8> {
        assert_eq!(self.send(payload), 1, "the mailbox takes a request");
        let response = self.receive().expect("a request is answered");
        assert_eq!(response[5] & 0x0f, 3, "by CoE: {response:02x?}");
        response[6..].to_vec()
    }

    /// Sends an SDO request of eight or more bytes; returns the response, or the abort code.
    pub fn sdo(&mut self, request: &[u8]) -> Result<Vec<u8>, u32> {
        let mut payload = vec![0x00, 0x20];
        payload.extend(request);
        payload.resize(payload.len().max(10), 0);
        let response = self.ask(&payload);
        let (service, sdo) = (response[1] >> 4, &response[2..]);
        match (service, sdo[0]) {
            (2, 0x80) => Err(u32::from_le_bytes(sdo[4..8].try_into().unwrap())),
            (3, _) => Ok(sdo.to_vec()),
            other => panic!("neither a response nor an abort: {other:x?}"),
        }
    }

    /// Reads an object, segmented if needed.
    pub fn upload(&mut self, index: u16, sub: u8) -> Result<Vec<u8>, u32> {
        self.upload_by(0x40, index, sub)
    }

    /// The same by complete access.
    pub fn upload_complete(&mut self, index: u16, sub: u8) -> Result<Vec<u8>, u32> {
        self.upload_by(0x50, index, sub)
    }

    fn upload_by(&mut self, command: u8, index: u16, sub: u8) -> Result<Vec<u8>, u32> {
        let [low, high] = index.to_le_bytes();
        let response = self.sdo(&[command, low, high, sub])?;
        assert_eq!(response[1..4], [low, high, sub]);
        if response[0] & 2 != 0 {
            return Ok(response[4..8 - usize::from(response[0] >> 2 & 3)].to_vec());
        }
        let size = u32::from_le_bytes(response[4..8].try_into().unwrap()) as usize;
        let mut bytes = response[8..].to_vec();
        let mut toggle = 0;
        while bytes.len() < size {
            let segment = self.sdo(&[0x60 | toggle])?;
            assert_eq!(segment[0] & 0x10, toggle);
            let unused = if segment.len() == 8 { usize::from(segment[0] >> 1 & 7) } else { 0 };
            bytes.extend(&segment[1..segment.len() - unused]);
            assert_eq!(segment[0] & 1 == 1, bytes.len() == size, "the last one is marked");
            toggle ^= 0x10;
        }
        Ok(bytes)
    }

    /// Writes an object: expedited, or segmented if needed.
    pub fn download(&mut self, index: u16, sub: u8, bytes: &[u8]) -> Result<(), u32> {
        self.download_by(0, index, sub, bytes)
    }

    /// The same by complete access.
    pub fn download_complete(&mut self, index: u16, sub: u8, bytes: &[u8]) -> Result<(), u32> {
        self.download_by(0x10, index, sub, bytes)
    }

    fn download_by(&mut self, complete: u8, index: u16, sub: u8, bytes: &[u8]) -> Result<(), u32> {
        let [low, high] = index.to_le_bytes();
        if (1..=4).contains(&bytes.len()) {
            let command = 0x23 | complete | (4 - bytes.len() as u8) << 2;
            let mut request = vec![command, low, high, sub];
            request.extend(bytes);
            assert_eq!(self.sdo(&request)?[..4], [0x60, low, high, sub]);
            return Ok(());
        }
        let room = usize::from(self.device.memory.mailbox_bytes) - 6 - 2;
        let mut request = vec![0x21 | complete, low, high, sub];
        request.extend((bytes.len() as u32).to_le_bytes());
        let (first, mut rest) = bytes.split_at(bytes.len().min(room - 8));
        request.extend(first);
        assert_eq!(self.sdo(&request)?[..4], [0x60, low, high, sub]);
        let mut toggle = 0;
        while !rest.is_empty() {
            let (data, behind) = rest.split_at(rest.len().min(room - 1));
            let unused = 7usize.saturating_sub(data.len()) as u8;
            let mut segment = vec![toggle | unused << 1 | u8::from(behind.is_empty())];
            segment.extend(data);
            assert_eq!(self.sdo(&segment)?[0], 0x20 | toggle);
            rest = behind;
            toggle ^= 0x10;
        }
        Ok(())
    }
}
