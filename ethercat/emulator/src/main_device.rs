//! A MainDevice for tests and examples: brings one SubDevice to a state by frames, and exchanges process data with it.
//!
//! It knows the SubDevice by its [`Device`], where a real one reads the EEPROM, and keeps to the PDOs that are assigned after
//! power-on. It waits between its frames, so that it runs beside the SubDevice in one thread.

use embassy_time::{Duration, Instant, Timer};
use ethercat_subdevice::al_state::AlState;
use ethercat_subdevice::device::Device;
use ethercat_subdevice::sync_manager::Channel;

use crate::frame::{Builder, datagrams};
use crate::registers::{AL_CONTROL, AL_STATUS, FMMU, WATCHDOG_DATA};
use crate::{Command, SharedChip, now};

/// How long a state may take.
const PATIENCE: Duration = Duration::from_secs(2);
/// Between two frames.
const PAUSE: Duration = Duration::from_micros(100);
/// Without outputs for so long they stop, in units of 100 us: what a busy host takes from a MainDevice must not stop them.
const WATCHDOG: u16 = 60_000;
/// Acknowledges an error, in AL control; one stands, in AL status.
const ERROR: u8 = 1 << 4;
/// Data that a frame holds in one datagram.
const DATAGRAM_BYTES_MAX: usize = 1_486;
/// Where outputs lie in the logical address space; inputs lie behind them.
const LOGICAL: u32 = 0;

/// The block of registers that sets a SyncManager up as `device` wants it after power-on.
pub fn sync_manager(device: &Device, channel: Channel) -> [u8; 8] {
    let [start_low, start_high] = device.memory.start(channel).to_le_bytes();
    let length = device.default_bytes(channel);
    let [length_low, length_high] = length.to_le_bytes();
    [start_low, start_high, length_low, length_high, channel.control(), 0, u8::from(length > 0), 0]
}

/// The FMMU in front of process data, its address and its block of registers: with outputs at `logical`, and inputs behind them.
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

/// Why a MainDevice could not do what was asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// The controller did not take the datagram: there is nothing, or the SubDevice has not read the request before.
    NotTaken,
    /// The SubDevice shows an error, with this AL status code.
    Error(u16),
    /// It is in another state when the time is over.
    Late(u8),
}

/// A MainDevice in front of one SubDevice.
pub struct MainDevice<'d> {
    chip: SharedChip,
    device: &'d Device,
}

impl<'d> MainDevice<'d> {
    /// A MainDevice whose only SubDevice has this controller, and is described by `device`.
    pub fn new(chip: SharedChip, device: &'d Device) -> Self {
        Self { chip, device }
    }

    /// Brings the SubDevice to `state` by the states between, and sets up on the way what each of them needs. An error that
    /// stands is acknowledged.
    pub async fn bring_to(&mut self, state: AlState) -> Result<(), Refusal> {
        let steps = [AlState::Init, AlState::PreOp, AlState::SafeOp, AlState::Op];
        for step in steps.into_iter().filter(|&step| step <= state) {
            match step {
                AlState::PreOp => self.set_up(&[Channel::MailboxOut, Channel::MailboxIn]).await?,
                AlState::SafeOp => {
                    self.write(WATCHDOG_DATA, &WATCHDOG.to_le_bytes()).await?;
                    self.set_up(&[Channel::Outputs, Channel::Inputs]).await?;
                }
                // It takes outputs to reach Op.
                AlState::Op => self.exchange(&vec![0; self.bytes(Channel::Outputs)]).await.map(|_| ())?,
                _ => {}
            }
            self.reach(step).await?;
        }
        Ok(())
    }

    /// Sends outputs and takes inputs, by one frame if that holds both; so the inputs are of a time before the SubDevice has seen these
    /// outputs.
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

    /// Writes to a register or to memory of the controller.
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

    /// Sets up SyncManagers, and for process data the FMMUs before them.
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

    /// Lets a frame with one datagram pass, and gives the SubDevice time; the datagram's data.
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
