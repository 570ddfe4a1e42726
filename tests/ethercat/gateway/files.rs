//! Settings, log and last frames as files for a MainDevice, by FoE in the states with objects.

mod random;

use std::cell::Cell;

use mobgate::capture::Capture;
use mobgate::console::serve_files;
use mobgate::fieldbus::{FileBuffer, updatable_device};
use mobgate::frame::{FramePool, Slot};
use mobgate::gateway::audit::AuditMemory;
use mobgate::gateway::{Candidate, Gateway, Ports};
use mobgate::hal::{Store, StoreError, System};
use mobgate::settings::PORTS_MAX;
use mobgate_simulator::console::typed;

use crate::files::client::*;
use crate::prelude::*;

type Objects = GatewayObjects<'static, &'static FileBuffer>;

/// The hash of a password.
const HASH: &str =
    "$argon2id$v=19$m=8,t=1,p=1$MDEyMzQ1Njc4OWFiY2RlZg$MbnuQj2xrGASZb+GaVRPOkBaCDUjNErQQKePN3mCUfA";

const CONF: &[u8] = b"mobgate.conf";

/// Settings with a user, whose password is a secret, and `rights` at the EtherCAT port.
fn lines(rights: &str) -> String {
    format!(
        "user anna role engineer password \"{HASH}\"
port ecat ethercat files {rights}
port bus  serial uart1 rtu client 19200 8E1
route ecat 1-247   * * bus
"
    )
}

/// The same as a MainDevice reads them.
fn read_lines(rights: &str) -> String {
    lines(rights).replace(&format!(" password \"{HASH}\""), "")
}

/// A store that takes its time, and may refuse; clones are handles of the same.
#[derive(Clone, Default)]
struct Disk {
    next: Rc<RefCell<String>>,
    saved: Rc<RefCell<Option<String>>>,
    who: Rc<RefCell<String>>,
    slow: Rc<Cell<u64>>,
    full: Rc<Cell<bool>>,
}

impl Store for Disk {
    async fn read(&mut self, _offset: usize, _into: &mut [u8]) -> Result<usize, StoreError> {
        Ok(0)
    }

    async fn append(&mut self, text: &[u8]) -> Result<(), StoreError> {
        self.next.borrow_mut().push_str(str::from_utf8(text).unwrap());
        Ok(())
    }

    async fn commit(&mut self) -> Result<(), StoreError> {
        if self.slow.get() > 0 {
            Timer::after_millis(self.slow.get()).await;
        }
        let next = self.next.take();
        if self.full.get() {
            return Err(StoreError::Full(7));
        }
        *self.saved.borrow_mut() = Some(next);
        Ok(())
    }

    fn overwrite(&mut self, whatever: bool) {
        assert!(!whatever, "what others have edited is theirs");
        self.next.take();
    }

    fn sign(&mut self, who: &dyn std::fmt::Display, _: impl FnOnce() -> Option<u64>) {
        *self.who.borrow_mut() = who.to_string();
    }
}

struct Board;

impl System for Board {
    fn name(&self) -> &str {
        "bench"
    }

    fn reboot(&self) {}
}

/// As long as the test.
fn leak<T>(value: T) -> &'static T {
    Box::leak(Box::new(value))
}

/// A gateway with `settings`.
fn gateway_with(settings: &str) -> &'static Gateway<'static> {
    let slots = leak([const { Slot::new() }; PORTS_MAX]);
    let (pool, ports) = (leak(FramePool::new(slots, PORTS_MAX)), leak(Ports::<PORTS_MAX>::new()));
    let gateway = Gateway::new(pool, ports, &[]).with_candidate(leak(Candidate::new()));
    let gateway = gateway.with_audit(leak(AuditMemory::new())).with_capture(leak(Capture::new()));
    let gateway = leak(gateway.with_ethercat(leak(EthercatState::new())));
    gateway.apply(&settings_of(settings)).unwrap();
    gateway
}

/// A gateway with its MainDevice, and where its settings are saved.
struct Files {
    rig: Rig<Objects>,
    gateway: &'static Gateway<'static>,
    disk: Disk,
}

impl Files {
    fn with(settings: &str, state: u16) -> Self {
        let (gateway, buffer, disk) = (gateway_with(settings), leak(FileBuffer::new()), Disk::default());
        let objects = GatewayObjects::new(gateway.ethercat().unwrap()).with_files(buffer);
        let mut rig = Rig::with_application(updatable_device(false), objects);
        let mut store = disk.clone();
        rig.world.spawn(async move { serve_files(gateway, buffer, &mut store, &Board).await });
        rig.bring_to(state);
        Self { rig, gateway, disk }
    }

    fn write(&mut self, text: &str) -> Option<Response> {
        write(&mut self.rig, "mobgate.conf", 0, text.as_bytes(), PACKET)
    }

    fn read(&mut self, name: &str) -> String {
        String::from_utf8(read(&mut self.rig, name, PACKET)).unwrap()
    }

    /// The settings in force, with secrets.
    fn in_force(&self) -> String {
        self.gateway.settings(|settings| {
            let mut text = String::new();
            (0..)
                .map_while(|n| mobgate::language::write_line(settings, n, &mut text).map(|_| text.push('\n')))
                .count();
            text
        })
    }

    fn audit(&self) -> Vec<String> {
        (0..)
            .map_while(|nth| self.gateway.audit_line(nth))
            .map(|line| line.text.replace('\t', ": "))
            .collect()
    }

    /// What the console prints.
    fn console(&mut self, text: &str) -> String {
        let gateway = self.gateway;
        self.rig.world.run_until(typed(gateway, text))
    }

    /// `text` is refused with this code and this text, which may go on, and changes nothing.
    fn refuses(&mut self, text: &str, code: u32, why: &str) {
        let before = self.in_force();
        let (found, words) = error(self.write(text));
        assert_eq!(found, code, "{text}: {words}");
        assert!(words.starts_with(why), "{text}: {words}");
        assert_eq!((self.in_force(), self.disk.saved.borrow().clone()), (before, None), "{text}");
        assert!(!self.gateway.has_unsaved(), "{text}");
    }
}

/// The code and the text of an error.
fn error(response: Option<Response>) -> (u32, String) {
    let (operation, code, text) = response.expect("an error is answered");
    assert_eq!(operation, ERR);
    (code, String::from_utf8(text).unwrap())
}

#[test]
fn without_the_word_there_are_no_files() {
    let off = "no such file: the EtherCAT port has files off";
    for settings in ["port ecat ethercat", "port ecat ethercat files off", ""] {
        let mut files = Files::with(settings, PRE_OP);
        for name in ["mobgate.conf", "mobgate.log", "capture.pcapng"] {
            for operation in [READ, WRITE] {
                let refused = error(ask(&mut files.rig, operation, 0, name.as_bytes()));
                let read_only = operation == WRITE && name != "mobgate.conf";
                assert_eq!(refused.0, if read_only { 0x8002 } else { 0x8001 }, "{name}");
                assert!(read_only || refused.1 == off, "{refused:?}");
            }
        }
    }
}

#[test]
fn what_is_only_to_be_read_is_not_written_and_other_names_do_not_exist() {
    let refused = error(ask(&mut Files::with(&lines("read"), PRE_OP).rig, WRITE, 0, CONF));
    assert_eq!(refused, (0x8002, "the EtherCAT port has files read".into()));
    for rights in ["read", "write"] {
        let mut files = Files::with(&lines(rights), PRE_OP);
        for (operation, name, code) in [
            (WRITE, "mobgate.log", 0x8002),
            (WRITE, "capture.pcapng", 0x8002),
            (READ, "mobgate.con", 0x8001),
            (READ, "", 0x8001),
            (WRITE, "../mobgate.conf", 0x8001),
            (WRITE, "firmware.mgu", 0x8001),
        ] {
            assert_eq!(error(ask(&mut files.rig, operation, 0, name.as_bytes())).0, code, "{name}");
        }
    }
}

#[test]
fn the_settings_are_read_in_each_state_as_show_config_has_them_and_never_a_secret() {
    for rights in ["read", "write"] {
        for state in [PRE_OP, SAFE_OP, OP] {
            let mut files = Files::with(&lines(rights), state);
            // Op goes on without outputs.
            files.rig.write(0x0420, &[0, 0]);
            let shown = files.console("show config\n");
            for name in ["mobgate.conf", "MOBGATE.CONF"] {
                assert_eq!(files.read(name), read_lines(rights));
            }
            assert_eq!(shown, read_lines(rights));
            assert!(files.in_force().contains(HASH), "there is a secret");
        }
    }
}

#[test]
fn in_boot_there_is_new_firmware_alone() {
    let mut files = Files::with(&lines("write"), BOOT);
    for operation in [READ, WRITE] {
        assert_eq!(error(ask(&mut files.rig, operation, 0, CONF)).0, 0x8009);
    }
}

#[test]
fn files_of_every_length_end_where_they_end() {
    let mut files = Files::with(&lines("read"), PRE_OP);
    let mut rests = [false; PACKET];
    for routes in 0..5 {
        for (length, words) in (1..=15).flat_map(|length| [(length, ""), (length, " prove-outputs")]) {
            let line = "L".repeat(length);
            let settings = lines("read").replace("files", &format!("line {line}{words} files"));
            let routes: String = (0..routes).map(|unit| format!("route ecat 20{unit} * * bus\n")).collect();
            files.gateway.apply(&settings_of(&(settings + &routes))).unwrap();
            let text = files.read("mobgate.conf");
            assert_eq!(text, files.console("show config\n"));
            rests[text.len() % PACKET] = true;
        }
    }
    assert_eq!(rests, [true; PACKET], "the last packet has had every length");
}

#[test]
fn what_is_written_is_in_force_and_saved_as_a_commit_by_ethercat_and_passwords_stay() {
    let mut files = Files::with(&lines("write"), PRE_OP);
    let text = files.read("mobgate.conf");
    let other = text.replace("1-247  ", "1-100  ");
    assert_ne!(other, text);
    assert_eq!(files.write(&other), None);
    let expected = lines("write").replace("1-247  ", "1-100  ");
    assert_eq!(files.in_force(), expected);
    assert_eq!(files.disk.saved.borrow().as_deref(), Some(&*expected), "the password as well");
    assert_eq!(*files.disk.who.borrow(), "EtherCAT");
    assert!(!files.gateway.has_unsaved());
    let expected = [
        "EtherCAT: - route ecat 1-247   * * bus",
        "EtherCAT: + route ecat 1-100   * * bus",
        "EtherCAT: mobgate.conf is in force and saved",
    ];
    assert_eq!(files.audit(), expected);
    let log = files.read("mobgate.log");
    for line in expected {
        assert!(log.contains(line.split_once(": ").unwrap().1), "{log}");
    }
    assert!(log.contains("AGE") && !log.contains("argon2"), "{log}");
    // Comments, other line ends and an end without one; and a user who is not in it is gone.
    let other = "# by hand\r\nport ecat ethercat files write";
    assert_eq!(files.write(other), None);
    assert_eq!(files.in_force(), "port ecat ethercat files write\n");
}

#[test]
fn what_is_wrong_is_named_with_its_line_and_nothing_has_changed() {
    let good = read_lines("write");
    let mut files = Files::with(&lines("write"), PRE_OP);
    for (text, code, why) in [
        ("prot x scanner\n", 0x8000, "line 1, column 1: \"prot\": expected port, server, route"),
        (
            &format!("{good}route ecat 300 * * bus\n"),
            0x8000,
            "line 5, column 12: \"300\": expected a unit id from 0 to 255",
        ),
        (&format!("{good}route ecat 7 * * nowhere"), 0x8000, "line 5, column 18: \"nowhere\": "),
        (
            &format!("{good}network dhcp\n"),
            0x8000,
            "line 5, column 1: \"network\": network lines are for boards",
        ),
        (&format!("{good}port a tcp server 502\n"), 0x8000, "line 5, column "),
        ("", 0x8002, "this would cut you off: the EtherCAT port is gone"),
        ("port other serial uart2 rtu client\n", 0x8002, "this would cut you off: the EtherCAT port is gone"),
        (&read_lines("read"), 0x8002, "this would cut you off: the EtherCAT port has no files write"),
        (&read_lines("off"), 0x8002, "this would cut you off: the EtherCAT port has no files write"),
    ] {
        let before = files.audit().len();
        files.refuses(text, code, why);
        assert_eq!(
            files.audit()[before..],
            ["EtherCAT: mobgate.conf is refused: nothing has changed"],
            "{text}"
        );
    }
    files.disk.full.set(true);
    let other = good.replace("1-247  ", "1-100  ");
    files.refuses(&other, 0x8003, "the settings do not fit: 7 bytes at most");
    files.disk.full.set(false);
    // Nobody is in the way afterwards.
    assert_eq!(files.console("edit port bus timeout 500ms\n"), "");
    assert_eq!(files.write(&other), None);
}

#[test]
fn a_commit_that_waits_for_its_confirmation_is_not_overwritten() {
    let mut files = Files::with(&lines("write"), PRE_OP);
    let good = files.read("mobgate.conf");
    files.console("candidate\nedit port bus timeout 500ms\ncommit confirmed 5m\n");
    let (code, why) = error(files.write(&good));
    assert_eq!(code, 0x8002);
    assert!(why.starts_with("a commit waits for its confirmation"), "{why}");
    assert!(files.in_force().contains("timeout 500ms"));
    // A candidate that is open is told at its own commit.
    files.console("rollback\ncandidate\nedit port bus timeout 600ms\n");
    assert_eq!(files.write(&good.replace("1-247  ", "1-100  ")), None);
    let told = files.console("commit\n");
    assert!(told.contains("the settings in force have changed: see `diff`"), "{told}");
}

#[test]
fn settings_that_change_while_they_are_read_are_not_mixed() {
    // More than is ahead already.
    let more: String = (1..9).map(|unit| format!("route ecat 20{unit}     * * bus\n")).collect();
    let mut files = Files::with(&(lines("read") + &more), PRE_OP);
    assert_eq!(ask(&mut files.rig, READ, 0, CONF).unwrap().0, DATA);
    files.console("edit port bus timeout 500ms\n");
    let (code, why) = error(ask(&mut files.rig, ACK, 1, &[]));
    assert_eq!((code, &*why), (0x8000, "the settings have changed meanwhile: read the file again"));
    let expected = (read_lines("read") + &more).replace("8E1\n", "8E1 timeout 500ms\n");
    assert_eq!(files.read("mobgate.conf"), expected);
}

#[test]
fn a_transfer_that_stops_ends_and_leaves_the_settings_to_others() {
    let begun = || {
        let mut files = Files::with(&lines("write"), PRE_OP);
        assert_eq!(ask(&mut files.rig, WRITE, 0, CONF), ack(0));
        assert_eq!(ask(&mut files.rig, DATA, 1, &[b'#'; PACKET]), ack(1));
        files
    };
    let is_free = |files: &mut Files| {
        let change = select(typed(files.gateway, "edit port bus timeout 500ms\n"), Timer::after_millis(100));
        matches!(files.rig.world.run_until(change), Either::First(_))
    };
    assert!(!is_free(&mut begun()), "nobody else changes them meanwhile");
    let ends: [fn(&mut Files); 4] = [
        |files| files.rig.pass(10_100),
        |files| assert_eq!(ask(&mut files.rig, ERR, 0x8000, b"given up"), None),
        |files| assert_eq!(files.rig.request(INIT), (INIT, 0)),
        |files| {
            let (code, why) = error(ask(&mut files.rig, READ, 0, CONF));
            assert_eq!((code, &*why), (0x8004, "another transfer was open, and has ended now: ask again"));
            assert_eq!(files.read("mobgate.conf"), read_lines("write"));
        },
    ];
    for end in ends {
        let mut files = begun();
        end(&mut files);
        files.rig.pass(5);
        assert!(is_free(&mut files));
        assert!(files.in_force().contains("timeout 500ms") && files.disk.saved.borrow().is_none());
    }
    // One that goes on, but too slowly.
    let mut files = begun();
    for number in 2..=8 {
        files.rig.pass(9_000);
        let response = ask(&mut files.rig, DATA, number, &[b'#'; PACKET]);
        if number < 8 {
            assert_eq!(response, ack(number));
        } else {
            assert_eq!(error(response), (0x8004, "the file is not open any more: it took too long".into()));
        }
    }
    assert!(is_free(&mut files));
}

#[test]
fn process_data_go_on_while_slow_memory_makes_the_gateway_busy() {
    let mut files = Files::with(&lines("write"), OP);
    files.disk.slow.set(450);
    let text = read_lines("write").replace("1-247  ", "1-100  ");
    let packets: Vec<&[u8]> = text.as_bytes().chunks(PACKET).collect();
    assert_eq!(ask(&mut files.rig, WRITE, 0, CONF), ack(0));
    let (mut busy, mut cycles) = (0, 0);
    for (number, packet) in (1..).zip(packets) {
        let response = loop {
            send(&mut files.rig, DATA, number, packet);
            let response = loop {
                assert_eq!(files.rig.cycle(7).1, 3, "outputs are taken, and inputs are there");
                cycles += 1;
                files.rig.pass(1);
                if let Some(response) = received(&mut files.rig) {
                    break response;
                }
            };
            match response {
                (BUSY, ..) => busy += 1,
                response => break Some(response),
            }
        };
        assert_eq!(response, ack(number));
    }
    assert!(busy >= 3 && cycles > 400, "busy {busy} times in {cycles} cycles");
    assert_eq!(files.rig.status(), (OP, 0));
    assert!(files.in_force().contains("1-100"));
}

#[test]
fn another_request_while_the_settings_are_being_saved_is_refused_and_they_are_saved() {
    let mut files = Files::with(&lines("write"), PRE_OP);
    files.disk.slow.set(2_000);
    let text = read_lines("write").replace("1-247  ", "1-100  ");
    assert_eq!(ask(&mut files.rig, WRITE, 0, CONF), ack(0));
    let mut packets = (1..).zip(text.as_bytes().chunks(PACKET)).peekable();
    while let Some((number, packet)) = packets.next() {
        let response = ask(&mut files.rig, DATA, number, packet);
        assert_eq!(response, if packets.peek().is_some() { ack(number) } else { None });
    }
    assert_eq!(ask(&mut files.rig, ERR, 0x8000, b"given up"), None);
    for operation in [READ, WRITE] {
        let (code, why) = error(ask(&mut files.rig, operation, 0, CONF));
        assert_eq!((code, &*why), (0x8004, "the last transfer is still being dealt with: ask again"));
    }
    files.rig.pass(2_000);
    assert!(files.read("mobgate.conf").contains("1-100"));
    assert!(files.disk.saved.borrow().is_some());
}

#[test]
fn the_last_frames_are_read_as_a_file_that_wireshark_knows() {
    let mut files = Files::with(&lines("read"), PRE_OP);
    let file = read(&mut files.rig, "capture.pcapng", PACKET);
    let (mut rest, mut blocks) = (&file[..], Vec::new());
    while !rest.is_empty() {
        let number = |at: usize| u32::from_le_bytes(rest[at..at + 4].try_into().unwrap());
        let length = number(4) as usize;
        assert_eq!(number(length - 4) as usize, length);
        blocks.push(number(0));
        rest = &rest[length..];
    }
    assert_eq!(blocks[0], 0x0a0d_0d0a, "the section");
    assert_eq!(blocks[1..], [1; PORTS_MAX], "an interface for each port, and no frame yet");
}
