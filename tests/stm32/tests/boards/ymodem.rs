//! A terminal that sends a file by YMODEM, as `sb` does (Forsberg, "XMODEM/YMODEM Protocol Reference", 1988).

use std::collections::VecDeque;
use std::time::Duration;

use mobgate_simulator::ymodem::{ACK, ASK, CAN, EOT, NAK, block, header};
use mobgate_stm32_emulator::{CONSOLE, Machine, Stop, Uart, ends_with_prompt};

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
        let mut steps = VecDeque::from([(&[ASK][..], block(0, &header(Some(file.len()))))]);
        for (nth, data) in file.chunks(1024).enumerate() {
            let after: &[u8] = if nth == 0 { &[ACK, ASK] } else { &[ACK] };
            steps.push_back((after, block((nth + 1) as u8, data)));
        }
        steps.push_back((&[ACK], vec![EOT]));
        steps.push_back((&[ACK, ASK], block(0, &[0; 128])));
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
