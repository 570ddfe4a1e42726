//! A MainDevice that writes a file by FoE (ETG.1000.6, 5.8) into a SubDevice in Boot.

use embassy_time::{Duration, Timer};
use ethercat_esc::MainDevice;
use ethercat_esc::main_device::{Refusal, sync_manager};
use ethercat_subdevice::al_state::AlState;
use ethercat_subdevice::device::Device;
use ethercat_subdevice::sync_manager::Channel;

const AL_CONTROL: u16 = 0x120;
const AL_STATUS: u16 = 0x130;
/// Status of a SyncManager, behind its other registers, and in it: the mailbox is full.
const STATUS: u16 = 5;
const FULL: u8 = 1 << 3;
/// The mailbox protocol.
const FOE: u8 = 4;
const WRITE: u8 = 2;
const DATA: u8 = 3;
const ERROR: u8 = 5;
const BUSY: u8 = 6;
/// Headers of the mailbox and of FoE.
const HEADERS_BYTES: usize = 12;

/// What a SubDevice refused the file with: a code, and a text.
pub type FileRefusal = (u32, String);

/// A MainDevice at its mailboxes.
pub(crate) struct Writer<'m, 'd> {
    main_device: &'m mut MainDevice<'d>,
    device: &'d Device,
    counter: u8,
}

impl<'m, 'd> Writer<'m, 'd> {
    pub(crate) fn new(main_device: &'m mut MainDevice<'d>, device: &'d Device) -> Self {
        Self { main_device, device, counter: 0 }
    }

    /// Brings the SubDevice to Boot, by Init, and writes `file`.
    pub(crate) async fn update(&mut self, name: &str, file: &[u8]) -> Result<Option<FileRefusal>, Refusal> {
        self.reach(AlState::Init).await?;
        for channel in [Channel::MailboxOut, Channel::MailboxIn] {
            self.main_device.write(channel.registers(), &sync_manager(self.device, channel)).await?;
        }
        self.reach(AlState::Boot).await?;
        self.write(name, file).await
    }

    async fn write(&mut self, name: &str, file: &[u8]) -> Result<Option<FileRefusal>, Refusal> {
        let packet_bytes = usize::from(self.device.default_bytes(Channel::MailboxOut)) - HEADERS_BYTES;
        let (mut operation, mut number, mut data) = (WRITE, 0, name.as_bytes());
        let mut rest = Some(file);
        loop {
            match self.ask(operation, number, data).await? {
                (ERROR, code, text) => return Ok(Some((code, String::from_utf8_lossy(&text).into_owned()))),
                (BUSY, ..) => continue,
                _ => {}
            }
            // A packet that is not full is the last one.
            let Some(left) = rest else { return Ok(None) };
            let (now, later) = left.split_at(left.len().min(packet_bytes));
            rest = (now.len() == packet_bytes).then_some(later);
            (operation, number, data) = (DATA, number + 1, now);
        }
    }

    /// Sends a message, and returns the operation, the number and the data of the response.
    async fn ask(&mut self, operation: u8, number: u32, data: &[u8]) -> Result<(u8, u32, Vec<u8>), Refusal> {
        self.counter = self.counter % 7 + 1;
        let length = (HEADERS_BYTES / 2 + data.len()) as u16;
        let mut message = length.to_le_bytes().to_vec();
        message.extend([0, 0, 0, FOE | self.counter << 4, operation, 0]);
        message.extend(number.to_le_bytes());
        message.extend(data);
        let (out, back) = (Channel::MailboxOut, Channel::MailboxIn);
        message.resize(self.device.default_bytes(out).into(), 0);
        self.main_device.write(self.device.memory.start(out), &message).await?;
        while self.main_device.read(back.registers() + STATUS, 1).await?[0] & FULL == 0 {
            Timer::after(Duration::from_micros(200)).await;
        }
        let response =
            self.main_device.read(self.device.memory.start(back), self.device.default_bytes(back).into());
        let response = response.await?;
        let end = HEADERS_BYTES / 2 + usize::from(u16::from_le_bytes([response[0], response[1]]));
        let number = u32::from_le_bytes([response[8], response[9], response[10], response[11]]);
        Ok((response[6], number, response[HEADERS_BYTES..end].to_vec()))
    }

    pub(crate) async fn reach(&mut self, state: AlState) -> Result<(), Refusal> {
        self.main_device.write(AL_CONTROL, &[state as u8, 0]).await?;
        loop {
            let status = self.main_device.read(AL_STATUS, 6).await?;
            match status[0] {
                reached if reached == state as u8 => return Ok(()),
                error if error & 0x10 != 0 => {
                    return Err(Refusal::Error(u16::from_le_bytes([status[4], status[5]])));
                }
                _ => Timer::after(Duration::from_millis(1)).await,
            }
        }
    }
}
