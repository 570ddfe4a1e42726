//! Transactions on the SPI: an instruction, an address, then double words, least significant byte first.

use embedded_hal_async::spi::{Operation, SpiDevice};

use crate::esc::EscError;

const WRITE: u8 = 0x02;
const READ: u8 = 0x03;
const FAST_READ: u8 = 0x0B;
const INCREMENT: u16 = 0x4000;
const DECREMENT: u16 = 0x8000;
/// Bytes of a dummy stream: more than the longest image.
pub(super) const STREAM_BYTES: usize = 640;
/// Fills a double word around the data bytes.
const PAD: [u8; 3] = [0; 3];

/// The SPI and its speed class.
pub(super) struct Bus<SPI> {
    spi: SPI,
    fast: bool,
}

/// The padding before and after `bytes` to whole double words, if the first byte is in lane `lane`.
fn pads(lane: usize, bytes: usize) -> (usize, usize) {
    (lane, (lane + bytes).wrapping_neg() % 4)
}

impl<SPI: SpiDevice> Bus<SPI> {
    pub(super) fn new(spi: SPI, fast: bool) -> Self {
        Self { spi, fast }
    }

    /// Reads one register.
    pub(super) async fn read(&mut self, register: u16) -> Result<u32, EscError> {
        let mut word = [0; 4];
        self.read_bytes(register, 0, &mut word).await?;
        Ok(u32::from_le_bytes(word))
    }

    /// Reads `register` and the next one.
    pub(super) async fn read_up(&mut self, register: u16) -> Result<(u32, u32), EscError> {
        self.read_two(register | INCREMENT).await
    }

    /// Reads `register` and then the one before it.
    pub(super) async fn read_down(&mut self, register: u16) -> Result<(u32, u32), EscError> {
        self.read_two(register | DECREMENT).await
    }

    async fn read_two(&mut self, address: u16) -> Result<(u32, u32), EscError> {
        let mut words = [0; 8];
        self.read_bytes(address, 0, &mut words).await?;
        let [a, b, c, d, e, f, g, h] = words;
        Ok((u32::from_le_bytes([a, b, c, d]), u32::from_le_bytes([e, f, g, h])))
    }

    /// Reads bytes, the first in byte lane `lane` of a double word.
    pub(super) async fn read_bytes(
        &mut self,
        address: u16,
        lane: usize,
        into: &mut [u8],
    ) -> Result<(), EscError> {
        let [high, low] = address.to_be_bytes();
        let head = [if self.fast { FAST_READ } else { READ }, high, low, 0];
        let head = head.get(..if self.fast { 4 } else { 3 }).unwrap_or_default();
        let (before, behind) = pads(lane, into.len());
        let (mut first, mut last) = (PAD, PAD);
        let first = first.get_mut(..before).unwrap_or_default();
        let last = last.get_mut(..behind).unwrap_or_default();
        let mut operations =
            [Operation::Write(head), Operation::Read(first), Operation::Read(into), Operation::Read(last)];
        self.spi.transaction(&mut operations).await.map_err(|_| EscError::Bus)
    }

    /// Reads `register` and the next three.
    pub(super) async fn read_four(&mut self, register: u16) -> Result<[u32; 4], EscError> {
        let mut bytes = [0; 16];
        self.read_bytes(register | INCREMENT, 0, &mut bytes).await?;
        let mut words = bytes.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word));
        Ok([(); 4].map(|()| words.next().unwrap_or_default()))
    }

    /// Transfers [`STREAM_BYTES`] dummy bytes through `address`: discarded if it `reads`, otherwise zeros.
    pub(super) async fn stream(&mut self, reads: bool, address: u16) -> Result<(), EscError> {
        const ZEROS: [u8; STREAM_BYTES / 8] = [0; STREAM_BYTES / 8];
        let [high, low] = address.to_be_bytes();
        let head = match (reads, self.fast) {
            (true, true) => &[FAST_READ, high, low, 0][..],
            (true, false) => &[READ, high, low],
            (false, _) => &[WRITE, high, low],
        };
        let mut operations = [
            Operation::Write(head),
            Operation::Write(&ZEROS),
            Operation::Write(&ZEROS),
            Operation::Write(&ZEROS),
            Operation::Write(&ZEROS),
            Operation::Write(&ZEROS),
            Operation::Write(&ZEROS),
            Operation::Write(&ZEROS),
            Operation::Write(&ZEROS),
        ];
        self.spi.transaction(&mut operations).await.map_err(|_| EscError::Bus)
    }

    /// Writes one register.
    pub(super) async fn write(&mut self, register: u16, word: u32) -> Result<(), EscError> {
        self.write_bytes(register, 0, &word.to_le_bytes()).await
    }

    /// Writes `register` and the next two.
    pub(super) async fn write_three(&mut self, register: u16, words: [u32; 3]) -> Result<(), EscError> {
        let mut bytes = [0; 12];
        bytes
            .as_chunks_mut::<4>()
            .0
            .iter_mut()
            .zip(words)
            .for_each(|(four, word)| *four = word.to_le_bytes());
        self.write_bytes(register | INCREMENT, 0, &bytes).await
    }

    /// Writes `register` and the next one.
    pub(super) async fn write_up(&mut self, register: u16, first: u32, second: u32) -> Result<(), EscError> {
        let both = u64::from(second) << 32 | u64::from(first);
        self.write_bytes(register | INCREMENT, 0, &both.to_le_bytes()).await
    }

    /// Writes bytes, the first in byte lane `lane` of a double word.
    pub(super) async fn write_bytes(
        &mut self,
        address: u16,
        lane: usize,
        bytes: &[u8],
    ) -> Result<(), EscError> {
        let [high, low] = address.to_be_bytes();
        let head = [WRITE, high, low];
        let (before, behind) = pads(lane, bytes.len());
        let mut operations = [
            Operation::Write(&head),
            Operation::Write(PAD.get(..before).unwrap_or_default()),
            Operation::Write(bytes),
            Operation::Write(PAD.get(..behind).unwrap_or_default()),
        ];
        self.spi.transaction(&mut operations).await.map_err(|_| EscError::Bus)
    }
}
