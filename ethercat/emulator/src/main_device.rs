//! A MainDevice for tests and examples: brings one SubDevice to a state, and exchanges process data with it.
//!
//! It knows the SubDevice by its [`Device`], where a real one reads the EEPROM, and keeps the PDO assignment of power-on. It waits
//! between its frames, so that it runs beside the SubDevice in one thread.

use embassy_time::{Duration, Instant, Timer};
use ethercat_subdevice::al_state::AlState;
use ethercat_subdevice::device::Device;
use ethercat_subdevice::sync_manager::Channel;

use crate::frame::{Builder, datagrams};
use crate::registers::{AL_CONTROL, AL_STATUS, FMMU, WATCHDOG_DATA};
use crate::{Command, SharedChip, now};

/// Timeout of a state change.
const PATIENCE: Duration = Duration::from_secs(2);
/// Pause between two frames.
const PAUSE: Duration = Duration::from_micros(100);
/// Watchdog time of the outputs, in units of 100 us: long, so that a busy host that delays the MainDevice does not trip it.
const WATCHDOG: u16 = 60_000;
/// In AL control: acknowledges an error; in AL status: an error is indicated.
const ERROR: u8 = 1 << 4;
/// Most data bytes of a frame with one datagram.
const DATAGRAM_BYTES_MAX: usize = 1_486;
/// Logical address of the outputs; inputs follow.
const LOGICAL: u32 = 0;

/// The register block that sets a SyncManager up as `device` needs it after power-on.
pub fn sync_manager(device: &Device, channel: Channel) -> [u8; 8] {
    let [start_low, start_high] = device.memory.start(channel).to_le_bytes();
    let length = device.default_bytes(channel);
    let [length_low, length_high] = length.to_le_bytes();
    [start_low, start_high, length_low, length_high, channel.control(), 0, u8::from(length > 0), 0]
}

/// The address and register block of a process data FMMU, with outputs at `logical`, followed by inputs.
pub fn fmmu(device: &Device, channel: Channel, logical: u32) -> Option<(u16, [u8; 16])> {
    let (nth, logical, way) = match channel {
        Channel::Outputs => (0, logical, 2),
        Channel::Inputs => (1, logical + u32::from(device.default_bytes(Channel::Outputs)), 1),
        Channel::MailboxOut | Channel::MailboxIn => return None,
    };
    let length = device.default_bytes(channel);
    let mut block = [0; 16];
    block[0..4].copy_from_slice(&logical.to_le_bytes());
    block[4..6].copy_from_slice(&length.to_le_bytes());
    // From the first bit of the first byte to the last bit of the last.
    block[7] = 7;
    block[8..10].copy_from_slice(&device.memory.start(channel).to_le_bytes());
    (block[11], block[12]) = (way, u8::from(length > 0));
    Some((FMMU + 16 * nth, block))
}

/// Why a MainDevice's request failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// The controller did not process the datagram: it is absent, or the SubDevice has not read the previous request.
    NotTaken,
    /// The SubDevice indicates an error, with this AL status code.
    Error(u16),
    /// It was still in this state at the timeout.
    Late(u8),
}

/// A MainDevice for one SubDevice.
pub struct MainDevice<'d> {
    chip: SharedChip,
    device: &'d Device,
}

impl<'d> MainDevice<'d> {
    /// A MainDevice whose only SubDevice has this controller and the description `device`.
    pub fn new(chip: SharedChip, device: &'d Device) -> Self {
        Self { chip, device }
    }

    /// Brings the SubDevice to `state` through the intermediate states, setting up what each of them needs. Acknowledges a pending
    /// error.
    pub async fn bring_to(&mut self, state: AlState) -> Result<(), Refusal> {
        let steps = [AlState::Init, AlState::PreOp, AlState::SafeOp, AlState::Op];
        for step in steps.into_iter().filter(|&step| step <= state) {
            match step {
                AlState::PreOp => self.set_up(&[Channel::MailboxOut, Channel::MailboxIn]).await?,
                AlState::SafeOp => {
                    self.write(WATCHDOG_DATA, &WATCHDOG.to_le_bytes()).await?;
                    self.set_up(&[Channel::Outputs, Channel::Inputs]).await?;
                }
                // Op requires valid outputs.
                AlState::Op => self.exchange(&vec![0; self.bytes(Channel::Outputs)]).await.map(|_| ())?,
                _ => {}
            }
            self.reach(step).await?;
        }
        Ok(())
    }

    /// Sends outputs and takes inputs, in one frame if both fit; so the inputs predate these outputs.
    pub async fn exchange(&mut self, outputs: &[u8]) -> Result<Vec<u8>, Refusal> {
        let mut data = outputs.to_vec();
        data.resize(outputs.len() + self.bytes(Channel::Inputs), 0);
        for (nth, part) in data.chunks_mut(DATAGRAM_BYTES_MAX).enumerate() {
            let address = LOGICAL + (nth * DATAGRAM_BYTES_MAX) as u32;
            let back = self.send(Builder::default().logical(Command::Lrw, address, part)).await?;
            part.copy_from_slice(&back);
        }
        Ok(data.split_off(outputs.len()))
    }

    /// Writes registers or memory of the controller.
    pub async fn write(&mut self, address: u16, bytes: &[u8]) -> Result<(), Refusal> {
        self.send(Builder::default().device(Command::Apwr, 0, address, bytes)).await.map(|_| ())
    }

    /// Reads registers or memory of the controller.
    pub async fn read(&mut self, address: u16, bytes: usize) -> Result<Vec<u8>, Refusal> {
        self.send(Builder::default().device(Command::Aprd, 0, address, &vec![0; bytes])).await
    }

    async fn reach(&mut self, state: AlState) -> Result<(), Refusal> {
        self.write(AL_CONTROL, &[state as u8 | ERROR, 0]).await?;
        let end = Instant::now() + PATIENCE;
        loop {
            let status = self.read(AL_STATUS, 6).await?;
            match status[0] {
                reached if reached == state as u8 => return Ok(()),
                error if error & ERROR != 0 => {
                    return Err(Refusal::Error(u16::from_le_bytes([status[4], status[5]])));
                }
                other if Instant::now() >= end => return Err(Refusal::Late(other)),
                _ => {}
            }
        }
    }

    /// Sets up SyncManagers, and the FMMUs of process data.
    async fn set_up(&mut self, channels: &[Channel]) -> Result<(), Refusal> {
        for &channel in channels {
            if let Some((register, block)) = fmmu(self.device, channel, LOGICAL) {
                self.write(register, &block).await?;
            }
            self.write(channel.registers(), &sync_manager(self.device, channel)).await?;
        }
        Ok(())
    }

    fn bytes(&self, channel: Channel) -> usize {
        self.device.default_bytes(channel).into()
    }

    /// Sends a frame with one datagram, and lets the SubDevice react; returns the datagram's data.
    async fn send(&mut self, frame: Builder) -> Result<Vec<u8>, Refusal> {
        let mut frame = frame.build();
        let came_back = self.chip.borrow_mut().pass(now(), &mut frame);
        Timer::after(PAUSE).await;
        match datagrams(&mut frame).next() {
            Some(datagram) if came_back && datagram.counter() > 0 => Ok(datagram.data().to_vec()),
            _ => Err(Refusal::NotTaken),
        }
    }
}
