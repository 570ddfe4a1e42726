//! A terminal that sends a file by YMODEM, as `sb` does (Forsberg, "XMODEM/YMODEM Protocol Reference", 1988).

use std::collections::VecDeque;
use std::time::Duration;

use mobgate_stm32_emulator::{CONSOLE, Machine, Stop, Uart, ends_with_prompt};

const SOH: u8 = 0x01;
const STX: u8 = 0x02;
const EOT: u8 = 0x04;
const ACK: u8 = 0x06;
const NAK: u8 = 0x15;
const CAN: u8 = 0x18;
const ASK: u8 = b'C';
/// What fills up the last block.
const PADDING: u8 = 0x1a;

/// Longest time until the console is back: the file, the swap and a start.
const BACK_MAX: Duration = Duration::from_secs(240);

/// What is sent, each after these bytes have come.
struct Sender {
    steps: VecDeque<(&'static [u8], Vec<u8>)>,
    /// Those of them that have come.
    heard: usize,
    last: Vec<u8>,
}

impl Sender {
    fn new(file: &[u8]) -> Self {
        let mut header = format!("firmware.mgu\0{}", file.len()).into_bytes();
        header.resize(128, 0);
        let mut steps = VecDeque::from([(&[ASK][..], block(0, SOH, header))]);
        for (nth, data) in file.chunks(1024).enumerate() {
            let mut data = data.to_vec();
            data.resize(1024, PADDING);
            let after: &[u8] = if nth == 0 { &[ACK, ASK] } else { &[ACK] };
            steps.push_back((after, block((nth + 1) as u8, STX, data)));
        }
        steps.push_back((&[ACK], vec![EOT]));
        steps.push_back((&[ACK, ASK], block(0, SOH, vec![0; 128])));
        Self { steps, heard: 0, last: Vec::new() }
    }

    /// What is sent after this byte.
    fn hear(&mut self, byte: u8) -> Option<Vec<u8>> {
        let &(after, _) = self.steps.front()?;
        match byte {
            CAN => self.steps.clear(),
            NAK => return Some(self.last.clone()),
            _ if byte == after[self.heard] => self.heard += 1,
            _ => {}
        }
        if self.heard < after.len() || self.steps.is_empty() {
            return None;
        }
        self.heard = 0;
        self.last = self.steps.pop_front()?.1;
        Some(self.last.clone())
    }
}

fn block(number: u8, kind: u8, data: Vec<u8>) -> Vec<u8> {
    let crc = data.iter().fold(0_u16, |crc, &byte| {
        (0..8).fold(crc ^ u16::from(byte) << 8, |crc, _| crc << 1 ^ if crc >> 15 != 0 { 0x1021 } else { 0 })
    });
    [&[kind, number, !number][..], &data, &crc.to_be_bytes()].concat()
}

/// As [`try_send`], where nothing stops the run.
pub(crate) fn send(
    machine: &mut Machine,
    command: &str,
    file: &[u8],
    meanwhile: impl FnMut(&mut Machine),
) -> String {
    try_send(machine, command, file, meanwhile).unwrap()
}

/// Types `command`, sends `file` when it is asked for, and returns what the terminal shows until the next prompt, be it of another run.
/// `meanwhile` is called each millisecond.
pub(crate) fn try_send(
    machine: &mut Machine,
    command: &str,
    file: &[u8],
    mut meanwhile: impl FnMut(&mut Machine),
) -> Result<String, Stop> {
    machine.sent(Uart::Console);
    machine.send(Uart::Console, format!("{command}\r").as_bytes(), CONSOLE);
    let echo = format!("{command}\r\n");
    let (mut sender, mut shown, mut is_echoed) = (Sender::new(file), String::new(), false);
    let end = machine.now() + BACK_MAX;
    while !is_echoed || !ends_with_prompt(&shown) {
        assert!(machine.now() < end, "{shown:?} {}", machine.place());
        machine.run(Duration::from_millis(1))?;
        meanwhile(machine);
        for sent in machine.sent(Uart::Console) {
            let byte = sent.character.data;
            if let Some(bytes) = is_echoed.then(|| sender.hear(byte)).flatten() {
                machine.send(Uart::Console, &bytes, CONSOLE);
            }
            shown.push(byte.into());
            if !is_echoed && shown.ends_with(&echo) {
                is_echoed = true;
                shown.clear();
            }
        }
    }
    Ok(shown)
}
