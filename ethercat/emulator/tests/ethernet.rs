//! Ethernet through mailboxes: a MainDevice that cuts frames and puts them together by itself, against the stack on a controller.

use ethercat_esc::Random;
use ethercat_esc::bench::{
    BOOT, Bench, ETHERNET_64, ETHERNET_128, FILES_128, INIT, OP, PRE_OP, Rig, SAFE_OP,
};
use ethercat_esc::world::random::each_seed;
use ethercat_subdevice::device::Device;
use ethercat_subdevice::eoe::EthernetError;

/// The longest frame.
const LONGEST: usize = 1514;
/// Types of messages.
const ERROR: u8 = 0;
const ETHERNET: u8 = 2;
const COE: u8 = 3;
const FILE: u8 = 4;
/// A CoE message: the upload of 1018h:01.
const ASK: [u8; 10] = [0, 0x20, 0x40, 0x18, 0x10, 1, 0, 0, 0, 0];

/// A frame of random bytes.
fn frame(random: &mut Random, bytes: usize) -> Vec<u8> {
    (0..bytes).map(|_| random.byte()).collect()
}

/// The fragments of a frame for a device with mailboxes of some bytes.
fn cut(frame: &[u8], number: usize, mailbox: usize) -> Vec<Vec<u8>> {
    let most = (mailbox - 10) / 32 * 32;
    let count = frame.len().div_ceil(most);
    let head = |nth: usize| {
        let place = if nth == 0 { frame.len().div_ceil(32) } else { nth * most / 32 };
        let word = (nth + place * 64 + number % 16 * 4096) as u16;
        [0, u8::from(nth + 1 == count), word as u8, (word >> 8) as u8]
    };
    frame.chunks(most).enumerate().map(|(nth, bytes)| [&head(nth)[..], bytes].concat()).collect()
}

/// Writes a message, uncounted, as soon as the mailbox takes it.
fn send(rig: &mut Rig<Bench>, protocol: u8, payload: &[u8]) {
    let taken = (0..50).any(|_| rig.send_counted(protocol, 0, payload) == 1);
    assert!(taken, "the mailbox is emptied");
}

fn send_frame(rig: &mut Rig<Bench>, bytes: &[u8], number: usize, mailbox: usize) {
    cut(bytes, number, mailbox).iter().for_each(|fragment| send(rig, ETHERNET, fragment));
}

/// The next message within some milliseconds: its type and its content.
fn receive(rig: &mut Rig<Bench>) -> Option<(u8, Vec<u8>)> {
    for _ in 0..5 {
        if let Some(message) = rig.receive() {
            assert_eq!(message[..6].len() + usize::from(message[0]), message.len());
            return Some((message[5] & 15, message[6..].to_vec()));
        }
        rig.pass(1);
    }
    None
}

fn ask(rig: &mut Rig<Bench>, payload: &[u8]) -> (u8, Vec<u8>) {
    send(rig, ETHERNET, payload);
    receive(rig).expect("a response")
}

/// Puts the device's fragments together; each must follow the one before.
#[derive(Default)]
struct Assembler {
    parts: Vec<Vec<u8>>,
    announced: usize,
    number: Option<u16>,
    frames: Vec<Vec<u8>>,
}

impl Assembler {
    fn take(&mut self, fragment: &[u8]) {
        let word = u16::from_le_bytes([fragment[2], fragment[3]]);
        let before = self.parts.concat();
        assert_eq!(fragment[0], 0, "a fragment on port 0");
        assert_eq!(usize::from(word & 63), self.parts.len(), "in order");
        let place = usize::from(word >> 6 & 63);
        match self.parts.is_empty() {
            true => {
                assert_ne!(self.number, Some(word >> 12), "each frame has another number");
                (self.number, self.announced) = (Some(word >> 12), place);
            }
            false => assert_eq!((self.number, place * 32), (Some(word >> 12), before.len())),
        }
        self.parts.push(fragment[4..].to_vec());
        if fragment[1] & 1 == 1 {
            let frame = core::mem::take(&mut self.parts).concat();
            assert_eq!(self.announced, frame.len().div_ceil(32));
            self.frames.push(frame);
        } else {
            assert_eq!(fragment[4..].len() % 32, 0, "whole units");
        }
    }
}

/// Reads all frames that the device has.
fn frames(rig: &mut Rig<Bench>) -> Vec<Vec<u8>> {
    let mut assembler = Assembler::default();
    while let Some((protocol, fragment)) = receive(rig) {
        assert_eq!(protocol, ETHERNET);
        assembler.take(&fragment);
    }
    assert!(assembler.parts.is_empty(), "each frame is whole");
    assembler.frames
}

fn received(rig: &Rig<Bench>) -> Vec<Vec<u8>> {
    rig.application().ethernet.link.received.clone()
}

fn give(rig: &Rig<Bench>, frames: &[Vec<u8>]) {
    rig.application().ethernet.link.waiting.extend(frames.iter().cloned());
}

fn with_mailboxes() -> [(&'static Device, usize); 2] {
    [(&ETHERNET_64, 64), (&ETHERNET_128, 128)]
}

#[test]
fn statement_52_frames_up_to_the_longest_pass_small_mailboxes_both_ways_in_each_state() {
    let mut random = Random::new(1);
    for (device, mailbox) in with_mailboxes() {
        for state in [PRE_OP, SAFE_OP, OP] {
            let mut rig = Rig::in_state(device, state);
            let all = [14, 60, 96, 97, LONGEST, 61].map(|bytes| frame(&mut random, bytes));
            for (number, frame) in all.iter().enumerate() {
                send_frame(&mut rig, frame, number, mailbox);
            }
            rig.pass(2);
            assert_eq!(received(&rig), all);
            give(&rig, &all);
            assert_eq!(frames(&mut rig), all);
        }
    }
}

#[test]
fn statement_52_a_lost_fragment_drops_its_frame_only() {
    let mut random = Random::new(2);
    for (device, mailbox) in with_mailboxes() {
        let all = [LONGEST, 300].map(|bytes| frame(&mut random, bytes));
        let first = cut(&all[0], 1, mailbox);
        for lost in 0..first.len() {
            let mut rig = Rig::in_state(device, PRE_OP);
            let kept = first.iter().enumerate().filter(|(nth, _)| *nth != lost);
            kept.for_each(|(_, fragment)| send(&mut rig, ETHERNET, fragment));
            send_frame(&mut rig, &all[1], 2, mailbox);
            rig.pass(2);
            assert_eq!(received(&rig), all[1..], "fragment {lost}");
        }
    }
}

#[test]
fn statement_52_a_frame_does_not_survive_a_pause_or_init() {
    let mut random = Random::new(3);
    let all = [300, 60].map(|bytes| frame(&mut random, bytes));
    let fragments = cut(&all[0], 1, 128);
    let first = |rig: &mut Rig<Bench>| fragments[..2].iter().for_each(|one| send(rig, ETHERNET, one));
    let rest = |rig: &mut Rig<Bench>| fragments[2..].iter().for_each(|one| send(rig, ETHERNET, one));
    for (pause, arrives) in [(900, true), (1_100, false)] {
        let mut rig = Rig::in_state(&ETHERNET_128, PRE_OP);
        first(&mut rig);
        rig.pass(pause);
        rest(&mut rig);
        rig.pass(2);
        assert_eq!(received(&rig).len(), usize::from(arrives), "{pause} ms");
    }
    let mut rig = Rig::in_state(&ETHERNET_128, PRE_OP);
    give(&rig, &all);
    first(&mut rig);
    assert!(receive(&mut rig).is_some(), "the first fragment of the first frame");
    assert_eq!(rig.request(INIT), (INIT, 0));
    rig.bring_to(PRE_OP);
    rest(&mut rig);
    assert_eq!(frames(&mut rig), all[1..]);
    assert!(received(&rig).is_empty());
}

#[test]
fn statement_52_ip_settings_are_set_and_read_and_refusals_have_codes() {
    // MAC, then addresses as numbers with their lowest byte first, then a name of 32 bytes.
    let name = [&b"mobgate"[..], &[0; 25]].concat();
    let block = [&[0x3f, 0, 0, 0, 2, 0, 0, 4, 5, 6][..], &[5, 1, 168, 192], &[0, 255, 255, 255]].concat();
    let block = [&block[..], &[1, 1, 168, 192], &[2, 1, 168, 192], &name].concat();
    for state in [PRE_OP, SAFE_OP, OP] {
        let mut rig = Rig::in_state(&ETHERNET_128, state);
        let set = ask(&mut rig, &[&[0x12, 1, 0, 0], &block[..]].concat());
        assert_eq!(set, (ETHERNET, vec![0x13, 1, 0, 0]));
        let settings = rig.application().ethernet.link.settings.clone();
        assert_eq!(settings.address, Some([192, 168, 1, 5].into()));
        assert_eq!(settings.name.as_deref(), Some("mobgate"));
        let read = ask(&mut rig, &[0x16, 1, 0, 0]);
        assert_eq!(read, (ETHERNET, [&[0x17, 1, 0, 0], &block[..]].concat()));
        // The address only, which is refused.
        rig.application().ethernet.link.unfit = Some(EthernetError::NoDhcpSupport);
        assert_eq!(
            ask(&mut rig, &[2, 1, 0, 0, 2, 0, 0, 0, 9, 1, 168, 192]),
            (ETHERNET, vec![3, 1, 0x02, 0x02])
        );
        assert_eq!(ask(&mut rig, &[4, 1, 0, 0]), (ETHERNET, vec![5, 1, 0x01, 0x04]));
        assert_eq!(ask(&mut rig, &[8, 1, 0, 0]), (ETHERNET, vec![9, 1, 0x01, 0x04]));
        assert_eq!(ask(&mut rig, &[10, 1, 0, 0]), (ERROR, vec![1, 0, 4, 0]));
        assert_eq!(ask(&mut rig, &[2, 1, 0]), (ERROR, vec![1, 0, 6, 0]));
        assert_eq!(ask(&mut rig, &[2, 1, 0, 0, 2, 0, 0, 0, 9]), (ERROR, vec![1, 0, 6, 0]));
    }
}

#[test]
fn statement_52_it_is_offered_by_the_device_that_has_it_and_not_in_boot() {
    for (device, state) in [(&FILES_128, PRE_OP), (&ETHERNET_128, BOOT)] {
        let mut rig = Rig::in_state(device, state);
        assert_eq!(ask(&mut rig, &[6, 1, 0, 0]), (ERROR, vec![1, 0, 2, 0]));
        give(&rig, &[vec![1; 60]]);
        assert_eq!(receive(&mut rig), None);
    }
}

#[test]
fn statement_52_the_eeprom_tells_of_it() {
    for (device, ethernet) in [(&FILES_128, false), (&ETHERNET_128, true)] {
        let mut image = [0; ethercat_description::sii::SII_BYTES];
        ethercat_description::sii::write(device, &mut image).unwrap();
        // CoE and FoE, and EoE.
        assert_eq!(image[0x38], if ethernet { 0x0e } else { 0x0c });
        let mut category = 0x80;
        while image[category] != 30 {
            category += 4 + 2 * usize::from(u16::from_le_bytes([image[category + 2], image[category + 3]]));
        }
        assert_eq!(image[category + 4 + 7], u8::from(ethernet));
    }
}

#[test]
fn statement_52_frames_that_wait_delay_a_response_by_one_message_and_lose_nothing() {
    let mut random = Random::new(4);
    let all: Vec<_> = (0..30).map(|_| frame(&mut random, LONGEST)).collect();
    let mut rig = Rig::in_state(&ETHERNET_128, PRE_OP);
    give(&rig, &all);
    let (mut assembler, mut responses) = (Assembler::default(), 0);
    while assembler.frames.len() < all.len() {
        // Between any two of its fragments.
        for _ in 0..random.within(0..=20) {
            let Some((protocol, message)) = receive(&mut rig) else { break };
            assert_eq!(protocol, ETHERNET);
            assembler.take(&message);
        }
        send(&mut rig, COE, &ASK);
        let before = (0..3).position(|_| match receive(&mut rig).expect("a message") {
            (COE, response) => {
                assert_eq!(response[..2], [0, 0x30]);
                true
            }
            (_, message) => {
                assembler.take(&message);
                false
            }
        });
        assert!(before.is_some_and(|before| before <= 1), "{before:?} messages before the response");
        responses += 1;
    }
    assert!(responses > 10);
    assert_eq!(assembler.frames, all);
}

#[test]
fn statement_52_transactions_pass_beside_process_data_at_1_ms() {
    const CYCLES: usize = 2_000;
    let mut random = Random::new(5);
    let mut rig = Rig::in_state(&ETHERNET_128, OP);
    rig.application().ethernet.link.echoes = true;
    let images = rig.application().images;
    let (mut assembler, mut sent) = (Assembler::default(), Vec::new());
    for cycle in 0..CYCLES {
        let (_, counter) = rig.cycle(cycle as u8);
        assert_eq!(counter, 3, "the device is in the cycle");
        if assembler.frames.len() == sent.len() {
            // A request of Modbus TCP: 54 bytes of headers, and 12.
            let request = frame(&mut random, 66);
            send_frame(&mut rig, &request, cycle, 128);
            sent.push(request);
        } else if let Some(message) = rig.receive() {
            assembler.take(&message[6..]);
        }
        rig.pass_since_exchange(1);
    }
    assert_eq!(rig.application().images - images, CYCLES, "each image was taken");
    assert_eq!(assembler.frames, sent[..assembler.frames.len()]);
    let per_second = assembler.frames.len() * 1_000 / CYCLES;
    assert!(per_second >= 200, "{per_second} transactions per second");
}

/// What a random MainDevice writes.
enum Message {
    /// A fragment: of which frame, and its number.
    Fragment(usize, usize),
    /// Anything, of a type; of Ethernet if it ends what is being received.
    Other(u8, Vec<u8>),
}

/// Fragments of some frames in their order but for some that are lost, late or repeated, and other messages between them.
fn script(random: &mut Random, frames: &[Vec<Vec<u8>>]) -> Vec<Message> {
    let mut order: Vec<_> =
        (0..frames.len()).flat_map(|id| (0..frames[id].len()).map(move |nth| (id, nth))).collect();
    for _ in 0..random.within(0..=6) {
        let at = random.index(order.len());
        match random.index(3) {
            0 if order.len() > 1 => drop(order.remove(at)),
            1 => order.insert(at, order[at]),
            _ => {
                let other = (at + 1 + random.index(4)).min(order.len() - 1);
                order.swap(at, other);
            }
        }
    }
    let mut script = Vec::new();
    for (id, nth) in order {
        if random.chance(0.3) {
            let protocol = [ETHERNET, FILE, FILE, COE, 9][random.index(5)];
            let length = 1 + random.index(60);
            let mut payload = frame(random, length);
            match protocol {
                FILE => payload[0] = 1 + payload[0] % 7,
                // Not often a fragment.
                ETHERNET if random.chance(0.8) => payload[0] |= 1 << random.index(4),
                _ => {}
            }
            script.push(Message::Other(protocol, payload));
        }
        script.push(Message::Fragment(id, nth));
    }
    script
}

/// The frames that arrive: those whose fragments come one after the other, from the first to the last.
fn arriving(script: &[Message], counts: &[usize]) -> Vec<usize> {
    let mut taken = Vec::new();
    for message in script {
        match message {
            Message::Fragment(id, nth) => taken.push((*id, *nth)),
            // With no complete header it is none of any frame.
            Message::Other(ETHERNET, payload) if payload[0] & 15 == 0 && payload.len() >= 4 => {
                taken.push((usize::MAX, 0));
            }
            Message::Other(..) => {}
        }
    }
    let starts = (0..taken.len()).filter(|&at| taken[at].1 == 0 && taken[at].0 != usize::MAX);
    let whole = starts.filter_map(|at| {
        let id = taken[at].0;
        let run = taken[at..].iter().take(counts[id]).copied();
        run.eq((0..counts[id]).map(|nth| (id, nth))).then_some(id)
    });
    whole.collect()
}

#[test]
fn statement_52_random_messages_of_ethernet_and_files_lose_what_they_break_and_nothing_else() {
    each_seed(1_000, |seed| {
        let mut random = Random::new(seed);
        let (device, mailbox) = with_mailboxes()[random.index(2)];
        let mut rig = Rig::in_state(device, [PRE_OP, OP][random.index(2)]);
        let frames: Vec<_> = (0..1 + random.index(8))
            .map(|_| {
                let bytes = random.within(14..=LONGEST as u64 / 3) as usize;
                frame(&mut random, bytes)
            })
            .collect();
        let fragments: Vec<_> =
            frames.iter().enumerate().map(|(id, bytes)| cut(bytes, id, mailbox)).collect();
        let script = script(&mut random, &fragments);
        for message in &script {
            let (protocol, payload) = match message {
                Message::Fragment(id, nth) => (ETHERNET, &fragments[*id][*nth]),
                Message::Other(protocol, payload) => {
                    (*protocol, &payload[..payload.len().min(mailbox - 6)].to_vec())
                }
            };
            while rig.send_counted(protocol, 0, payload) == 0 {
                let (protocol, _) = receive(&mut rig).expect("a mailbox is full of responses");
                assert!([ERROR, ETHERNET, COE, FILE].contains(&protocol), "seed {seed}");
            }
        }
        while receive(&mut rig).is_some() {}
        let counts: Vec<_> = fragments.iter().map(Vec::len).collect();
        let expected: Vec<_> = arriving(&script, &counts).iter().map(|&id| frames[id].clone()).collect();
        let whole: Vec<_> = received(&rig).into_iter().filter(|frame| frames.contains(frame)).collect();
        assert_eq!(whole, expected, "seed {seed}");
        serves_after_all(&mut rig, mailbox, seed);
    });
}

/// From Init on everything is served again.
fn serves_after_all(rig: &mut Rig<Bench>, mailbox: usize, seed: u64) {
    assert_eq!(rig.request(INIT), (INIT, 0), "seed {seed}");
    assert!(!rig.application().files.is_open(), "seed {seed}");
    rig.application().ethernet.link.received.clear();
    rig.bring_to(PRE_OP);
    let last = vec![7; LONGEST];
    send_frame(rig, &last, 3, mailbox);
    rig.pass(2);
    assert_eq!(received(rig), std::slice::from_ref(&last), "seed {seed}");
    give(rig, std::slice::from_ref(&last));
    let mut assembler = Assembler::default();
    while let Some((_, fragment)) = receive(rig) {
        // The port of whatever came before.
        assembler.take(&[&[0], &fragment[1..]].concat());
    }
    assert_eq!(assembler.frames, [last], "seed {seed}");
    assert_eq!(rig.sdo(&ASK[2..]).map(|response| response[0]), Ok(0x43), "seed {seed}");
}
