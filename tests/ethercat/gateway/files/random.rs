//! Random fragments, orders and lengths of FoE's messages against the gateway's files, without a chip: nothing panics, nothing stays
//! open, and each refusal is one of the protocol.

use ethercat_subdevice::foe::{ABANDONED_AFTER, Foe};
use ethercat_subdevice::mailbox::MailboxError;

use super::*;

const SEEDS: u64 = 1_000;
const MESSAGES: usize = 60;
/// Bytes of a mailbox behind its header.
const ROOM: usize = PACKET + 6;

/// The SubDevice's side of FoE in PreOp, and the gateway behind it.
struct Pair {
    foe: Foe,
    buffer: &'static FileBuffer,
    gateway: &'static Gateway<'static>,
    world: World<'static>,
}

impl Pair {
    fn new(seed: u64, gateway: &'static Gateway<'static>) -> Self {
        // What another seed has written is gone.
        gateway.apply(&settings_of(&lines("write"))).unwrap();
        let (world, buffer) = (World::new(seed), leak(FileBuffer::new()));
        world.spawn(async move { serve_files(gateway, buffer, &mut Disk::default(), &Board).await });
        let mut pair = Self { foe: Foe::default(), buffer, gateway, world };
        pair.pass(1);
        pair
    }

    fn pass(&mut self, millis: u64) {
        self.world.run_for(Duration::from_millis(millis));
        self.foe.expire(&mut self.buffer, Instant::now());
    }

    /// Sends a message; the response, if there is one within some milliseconds.
    fn ask(&mut self, message: &[u8]) -> Result<Option<Response>, MailboxError> {
        let files = &mut self.buffer;
        let mut response = self.foe.request(message, files, AlState::PreOp, ROOM, Instant::now())?;
        for _ in 0..5 {
            if response.is_none() {
                self.pass(1);
                response = self.foe.next(&mut self.buffer, ROOM, Instant::now());
            }
        }
        Ok(response.map(|bytes| {
            assert!(bytes.len() >= 6 && bytes.len() <= ROOM && bytes[1] == 0, "{bytes:02x?}");
            (bytes[0], u32::from_le_bytes(bytes[2..6].try_into().unwrap()), bytes[6..].to_vec())
        }))
    }

    fn say(&mut self, operation: u8, number: u32, rest: &[u8]) -> Option<Response> {
        self.ask(&[&[operation, 0], &number.to_le_bytes()[..], rest].concat()).unwrap()
    }

    /// The whole settings, read as a MainDevice does that means it.
    fn read(&mut self) -> String {
        let mut text = Vec::new();
        let mut response = self.say(READ, 0, CONF);
        loop {
            let (operation, number, data) = response.expect("data");
            assert_eq!(operation, DATA, "{}", String::from_utf8_lossy(&data));
            text.extend(&data);
            response = self.say(ACK, number, &[]);
            if data.len() < PACKET {
                return String::from_utf8(text).unwrap();
            }
        }
    }
}

/// A message as it should be, or nearly.
fn message(random: &mut Random, text: &[u8]) -> Vec<u8> {
    let operation = if random.chance(0.05) { random.byte() } else { random.within(1..=6) as u8 };
    let number = match random.index(10) {
        0 => random.within(0..=u64::from(u32::MAX)) as u32,
        _ => random.within(0..=4) as u32,
    };
    let names: [&[u8]; 6] =
        [CONF, CONF, b"mobgate.log", b"capture.pcapng", b"firmware.mgu", b"mobgate.con\xff"];
    let length = [0, 1, PACKET, random.index(PACKET)][random.index(4)];
    let data = match operation {
        READ | WRITE if random.chance(0.95) => names[random.index(names.len())].to_vec(),
        // A piece of good settings, or of anything.
        _ if random.chance(0.7) => {
            let at = if random.chance(0.5) { 0 } else { random.index(text.len()) };
            text[at..].iter().copied().take(length).collect()
        }
        _ => (0..length).map(|_| random.byte()).collect(),
    };
    let mut message = [&[operation, 0], &number.to_le_bytes()[..], &data].concat();
    if random.chance(0.1) {
        message.truncate(random.index(message.len()));
    }
    message
}

#[test]
fn random_fragments_orders_and_lengths_of_messages_leave_nothing_open() {
    let text = read_lines("write");
    // It is the same for all: what one of them has left would be in the way of the next.
    let gateway = gateway_with(&lines("write"));
    let (mut seeds, mut refusals) = (0, 0);
    each_seed(SEEDS, |seed| {
        seeds += 1;
        let mut random = Random::new(seed);
        let mut pair = Pair::new(seed, gateway);
        for _ in 0..MESSAGES {
            match pair.ask(&message(&mut random, text.as_bytes())) {
                Ok(None | Some((DATA | ACK | BUSY, ..))) => {}
                Ok(Some((ERR, code, why))) => {
                    refusals += 1;
                    assert!((0x8000..=0x8011).contains(&code), "seed {seed}: {code:x}");
                    let why = String::from_utf8(why).unwrap();
                    assert!(!why.is_empty() && !why.contains("argon2"), "seed {seed}: {why}");
                }
                Err(MailboxError::SizeTooShort) => {}
                other => panic!("seed {seed}: {other:?}"),
            }
            if random.chance(0.1) {
                pair.pass(random.within(0..=20));
            }
        }
        // Nobody says anything more: what was open is given up, and the settings are everybody's again.
        pair.pass(ABANDONED_AFTER.as_millis() + 100);
        let freed = select(typed(pair.gateway, "edit port bus timeout 500ms\n"), Timer::after_millis(100));
        assert!(matches!(pair.world.run_until(freed), Either::First(_)), "seed {seed}");
        pair.world.run_until(typed(pair.gateway, "edit port bus timeout 1s\n"));
        let whole = pair.read();
        assert!(whole.contains("files write"), "seed {seed}: {whole}");
        assert!(!whole.contains("argon2"), "seed {seed}: {whole}");
    });
    assert!(refusals > seeds, "{refusals} refusals in {seeds} seeds");
}
