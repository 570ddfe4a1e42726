//! A sender of YMODEM, whose blocks may be lost, cut or corrupt on their way.

use embassy_time::{Duration, with_timeout};
use embedded_io_async::{Read, Write};

use crate::random::Random;

const SOH: u8 = 0x01;
const STX: u8 = 0x02;
/// The end of the file.
pub const EOT: u8 = 0x04;
/// The receiver has taken a block.
pub const ACK: u8 = 0x06;
/// It wants the block again.
pub const NAK: u8 = 0x15;
/// It wants no more.
pub const CAN: u8 = 0x18;
/// It asks for a block with a CRC.
pub const ASK: u8 = b'C';
/// What fills up the last block.
const PADDING: u8 = 0x1a;

/// Block `number`: 1024 bytes, or 128 where `data` fits into them, with what surrounds them.
pub fn block(number: u8, data: &[u8]) -> Vec<u8> {
    let (first, length) = if data.len() > 128 { (STX, 1024) } else { (SOH, 128) };
    let mut padded = data.to_vec();
    padded.resize(length, PADDING);
    let crc = crc16(&padded).to_be_bytes();
    [&[first, number, !number][..], &padded, &crc].concat()
}

/// The data of block 0 before a file, with its length if that is told, and its time and mode behind it, as `sb` has them.
pub fn header(length: Option<usize>) -> Vec<u8> {
    let length = length.map(|length| format!("{length} 14716024117 100644")).unwrap_or_default();
    let mut header = format!("firmware.mgu\0{length}").into_bytes();
    header.resize(128, 0);
    header
}

/// How long it waits for a response.
const PATIENCE: Duration = Duration::from_secs(10);
/// How often it sends a block.
const SENT_MAX: u32 = 12;

/// How likely something happens to a block.
#[derive(Debug, Clone, Copy, Default)]
pub struct Weather {
    /// A bit of it changes.
    pub corrupt: f64,
    /// It is lost as a whole.
    pub lost: f64,
    /// A byte of it is lost.
    pub cut: f64,
    /// Its response is lost, and it is sent again.
    pub deaf: f64,
}

/// Why a file was not sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NotSent {
    /// The receiver cancelled.
    Cancelled,
    /// The receiver does not respond.
    Silent,
}

/// A sender at one end of `stream`.
pub struct Sender<IO> {
    /// The terminal's line.
    pub stream: IO,
    /// What happens to blocks.
    pub weather: Weather,
    random: Random,
}

impl<IO: Read + Write> Sender<IO> {
    /// A sender; `seed` chooses the blocks to which something happens.
    pub fn new(stream: IO, weather: Weather, seed: u64) -> Self {
        Self { stream, weather, random: Random::new(seed) }
    }

    /// Types `text`.
    pub async fn type_in(&mut self, text: &str) {
        self.stream.write_all(text.as_bytes()).await.expect("the line");
    }

    /// Reads what is shown until nothing comes for `quiet`.
    pub async fn read_for(&mut self, quiet: Duration) -> String {
        let mut shown = Vec::new();
        while let Ok(byte) = with_timeout(quiet, self.byte()).await {
            match byte {
                Some(byte) => shown.push(byte),
                None => break,
            }
        }
        String::from_utf8_lossy(&shown).into_owned()
    }

    /// Sends `file` in blocks of 1024 bytes, or of 128, with its length in block 0 or without.
    pub async fn send(&mut self, file: &[u8], long: bool, with_length: bool) -> Result<(), NotSent> {
        self.asked().await?;
        self.block(0, &header(with_length.then_some(file.len()))).await?;
        self.asked().await?;
        let mut number = 0u8;
        for data in file.chunks(if long { 1024 } else { 128 }) {
            number = number.wrapping_add(1);
            self.block(number, data).await?;
        }
        self.acknowledged(&[EOT]).await?;
        self.asked().await?;
        // The file is whole: the receiver does not wait for this for ever.
        self.weather = Weather::default();
        self.block(0, &[0; 128]).await
    }

    /// Sends the beginning of `file`, and then nothing.
    pub async fn send_half(&mut self, file: &[u8]) {
        let length = file.len();
        self.asked().await.expect("it asks");
        self.block(0, &header(Some(length))).await.expect("it takes the header");
        self.asked().await.expect("it asks");
        for (number, data) in (1..).zip(file[..length / 2].chunks(1024)) {
            self.block(number, data).await.expect("it takes a block");
        }
    }

    async fn asked(&mut self) -> Result<(), NotSent> {
        loop {
            match with_timeout(PATIENCE, self.byte()).await {
                Ok(Some(ASK)) => return Ok(()),
                Ok(Some(CAN)) => return Err(NotSent::Cancelled),
                Ok(Some(_)) => {}
                _ => return Err(NotSent::Silent),
            }
        }
    }

    async fn block(&mut self, number: u8, data: &[u8]) -> Result<(), NotSent> {
        self.acknowledged(&block(number, data)).await
    }

    /// Sends `bytes` until they are acknowledged.
    async fn acknowledged(&mut self, bytes: &[u8]) -> Result<(), NotSent> {
        for _ in 0..SENT_MAX {
            self.send_in_weather(bytes).await;
            loop {
                match with_timeout(PATIENCE, self.byte()).await {
                    Ok(Some(ACK)) if self.random.chance(self.weather.deaf) => {}
                    Ok(Some(ACK)) => return Ok(()),
                    Ok(Some(CAN)) => return Err(NotSent::Cancelled),
                    // A receiver that has not seen block 0 goes on asking.
                    Ok(Some(NAK | ASK)) | Err(_) => break,
                    Ok(Some(_)) => {}
                    Ok(None) => return Err(NotSent::Silent),
                }
            }
        }
        Err(NotSent::Silent)
    }

    async fn send_in_weather(&mut self, bytes: &[u8]) {
        let mut bytes = bytes.to_vec();
        let Weather { corrupt, lost, cut, .. } = self.weather;
        if self.random.chance(lost) {
            return;
        }
        // What has no check must not become something else.
        if bytes.len() > 1 && self.random.chance(corrupt) {
            let at = self.random.within(1..=bytes.len() as u64 - 1) as usize;
            bytes[at] ^= 1 << self.random.index(8);
        }
        if bytes.len() > 1 && self.random.chance(cut) {
            bytes.remove(self.random.index(bytes.len()));
        }
        self.stream.write_all(&bytes).await.expect("the line");
    }

    async fn byte(&mut self) -> Option<u8> {
        let mut byte = [0];
        matches!(self.stream.read(&mut byte).await, Ok(1)).then_some(byte[0])
    }
}

/// CRC-16/XMODEM, bit by bit.
fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0, |crc, byte| {
        (0..8).fold(crc ^ (u16::from(*byte) << 8), |crc, _| {
            if crc & 0x8000 == 0 { crc << 1 } else { (crc << 1) ^ 0x1021 }
        })
    })
}
