//! The program with serial devices that are missing, come, go and babble: PTYs under names of the tests' own.

use std::os::unix::fs::symlink;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use serial2::SerialPort;

use common::{Program, ask, converse, wait_for};

mod common;

const READ: [u8; 5] = [3, 0, 0, 0, 1];
const RESPONSE: [u8; 4] = [3, 2, 0xab, 0xcd];
/// Unit 1's request and response with their CRC.
const RESPONSE_RTU: [u8; 7] = [1, 3, 2, 0xab, 0xcd, 0x06, 0xe1];
const NO_RESPONSE: [u8; 2] = [0x83, 0x0b];
const NO_PATH: [u8; 2] = [0x83, 0x0a];

/// A device behind the link `name`: answers every request until its end of the PTY is dropped.
struct Adapter {
    // The inner end stays open, or the PTY hangs up before the program has opened it.
    _inside: SerialPort,
    outside: SerialPort,
}

impl Adapter {
    fn plug(name: &Path) -> Self {
        let (outside, inside) = SerialPort::pair().unwrap();
        let device = rustix::termios::ttyname(&inside, Vec::new()).unwrap();
        let _ = std::fs::remove_file(name);
        symlink(device.to_str().unwrap(), name).unwrap();
        Self { _inside: inside, outside }
    }

    /// Responds as many requests.
    fn answering(mut self, requests: usize) -> JoinHandle<Self> {
        thread::spawn(move || {
            (0..requests).for_each(|_| self.respond());
            self
        })
    }

    /// Answers one request.
    fn respond(&mut self) {
        let mut request = [0; 8];
        self.outside.set_read_timeout(common::PATIENCE).unwrap();
        self.outside.read_exact(&mut request).unwrap();
        self.outside.write_all(&RESPONSE_RTU).unwrap();
    }
}

/// A TCP server before a client with these words at `device`.
fn settings(device: &Path, words: &str) -> String {
    format!(
        "port P1 serial {} rtu client {words}\nport P502 tcp server {{port}}\nroute P502 * * * P1\n",
        device.display()
    )
}

fn program(device: &Path) -> Program {
    Program::configured(&settings(device, "timeout 200ms"))
}

#[test]
fn a_device_that_does_not_exist_is_reported_and_found_when_it_comes() {
    let folder = tempfile::tempdir().unwrap();
    let name = folder.path().join("usb-adapter");
    let program = program(&name);
    program.logs("cannot be opened: not found");
    let mut client = program.connect();
    assert_eq!(ask(&mut client, 1, &READ), NO_PATH);

    let adapter = Adapter::plug(&name);
    program.logs("is open");
    let responding = adapter.answering(1);
    assert_eq!(ask(&mut client, 1, &READ), RESPONSE);
    drop(responding.join().unwrap());
}

#[test]
fn an_unplugged_adapter_is_opened_again_when_it_is_back() {
    let folder = tempfile::tempdir().unwrap();
    let name = folder.path().join("usb-adapter");
    let adapter = Adapter::plug(&name);
    let program = program(&name);
    program.logs("is open");
    std::fs::remove_file(&name).unwrap();
    drop(adapter);
    program.logs("is lost");

    let adapter = Adapter::plug(&name);
    wait_for("the line again", || (program.log().matches("is open").count() == 2).then_some(()));
    let responding = adapter.answering(1);
    assert_eq!(ask(&mut program.connect(), 1, &READ), RESPONSE);
    drop(responding.join().unwrap());
}

#[test]
fn a_line_that_babbles_stops_nobody_else() {
    let folder = tempfile::tempdir().unwrap();
    let (noisy, quiet) = (folder.path().join("noisy"), folder.path().join("quiet"));
    let (babbler, adapter) = (Adapter::plug(&noisy), Adapter::plug(&quiet));
    let program = Program::configured(&format!(
        "port N1 serial {} rtu client timeout 200ms\nport Q1 serial {} rtu client timeout 10s late-window 200ms\n\
         port P502 tcp server {{port}} lifetime 2s\nroute P502 2 * * N1\nroute P502 1 * * Q1\n",
        noisy.display(),
        quiet.display()
    ));
    wait_for("both lines", || (program.log().matches("is open").count() == 2).then_some(()));
    let end = Arc::new(AtomicBool::new(false));
    let over = end.clone();
    let babble = thread::spawn(move || {
        while !over.load(Ordering::Relaxed) {
            // Full buffers are the point: whatever is not taken is written again.
            let _ = babbler.outside.write(&[0x55; 4096]);
        }
    });
    let responses = adapter.answering(20);
    let mut client = program.connect();
    for _ in 0..20 {
        assert_eq!(ask(&mut client, 1, &READ), RESPONSE);
    }
    assert_eq!(ask(&mut client, 2, &READ), NO_RESPONSE, "the request's life is over");
    end.store(true, Ordering::Relaxed);
    babble.join().unwrap();
    drop(responses.join().unwrap());
}

/// A PTY has no speed, so the unit is found at the first one.
#[test]
fn a_scan_finds_a_unit_and_leaves_the_port_as_it_was() {
    const REQUEST: [u8; 8] = [1, 3, 0, 0, 0, 1, 0x84, 0x0a];
    let folder = tempfile::tempdir().unwrap();
    let name = folder.path().join("usb-adapter");
    let adapter = Adapter::plug(&name);
    let program = common::with_console(&settings(&name, "115200"));
    program.logs("is open");
    let end = Arc::new(AtomicBool::new(false));
    let over = end.clone();
    let device = thread::spawn(move || {
        let mut adapter = adapter;
        adapter.outside.set_read_timeout(Duration::from_millis(100)).unwrap();
        let mut heard = [0; 64];
        while !over.load(Ordering::Relaxed) {
            // Whoever closes the line flushes it: a request may come without its beginning, and is asked again by nobody.
            if let Ok(count) = adapter.outside.read(&mut heard)
                && heard[..count].ends_with(&REQUEST)
            {
                adapter.outside.write_all(&RESPONSE_RTU).unwrap();
            }
        }
    });
    let mut console = program.session();
    let said = converse(&mut console, "scan P1 9600 19200 units 1-3 timeout 200ms\n", "# units 1");
    assert!(said.contains("unit   1 9600 8E1"), "{said}");
    assert!(said.contains("1 units found in "), "{said}");
    assert!(said.contains("edit port P1 9600 8E1     # units 1"), "{said}");
    // The line is opened once more, with its own settings.
    let mut client = program.connect();
    wait_for("the port's own traffic", || (ask(&mut client, 1, &READ) == RESPONSE).then_some(()));
    end.store(true, Ordering::Relaxed);
    device.join().unwrap();
}

#[test]
fn a_line_open_in_another_program_is_said_to_be_in_use() {
    let folder = tempfile::tempdir().unwrap();
    let name = folder.path().join("usb-adapter");
    let _adapter = Adapter::plug(&name);
    let first = program(&name);
    first.logs("is open");
    program(&name).logs("in use by another program");
}

#[test]
fn a_master_behind_an_adapter_is_answered_in_both_framings() {
    // Unit 7's loop-back test, whose response is the request.
    let frames: [(&str, &[u8]); 2] =
        [("rtu", &[7, 8, 0, 0, 0xa5, 0x37, 0xda, 0xeb]), ("ascii", b":07080000A53715\r\n")];
    for (framing, frame) in frames {
        let folder = tempfile::tempdir().unwrap();
        let name = folder.path().join("usb-adapter");
        let mut adapter = Adapter::plug(&name);
        let program = Program::configured(&format!(
            "port S serial {} {framing} server\nport P502 tcp server {{port}}\nroute S 7 * * local\n",
            name.display()
        ));
        program.logs("is open");
        adapter.outside.set_read_timeout(Duration::from_secs(2)).unwrap();
        let mut answered = 0;
        wait_for("three responses", || {
            // A repeat that comes as fast as an echo would be taken for one.
            thread::sleep(Duration::from_millis(50));
            adapter.outside.write_all(frame).unwrap();
            let mut response = vec![0; frame.len()];
            // Who is switched on hears a silence first: what comes before is no frame, and a busy machine sees silences late.
            if adapter.outside.read_exact(&mut response).is_ok() {
                assert_eq!(response, frame, "{framing}");
                answered += 1;
            }
            (answered == 3).then_some(())
        });
    }
}

/// A response is slept through until its last character is about to come; a character at 1200 baud takes 9 ms. On a busy machine
/// it may come much later, so the silence that ends a frame is longer here than it has to be.
#[test]
fn a_response_at_the_pace_of_a_slow_wire_is_heard_and_one_that_stops_half_way_is_not_waited_for() {
    const CHARACTER: Duration = Duration::from_millis(9);
    let folder = tempfile::tempdir().unwrap();
    let name = folder.path().join("slow");
    let mut adapter = Adapter::plug(&name);
    let words = "1200 gap 400ms timeout 5s late-window 0 proof none";
    let program = Program::configured(&settings(&name, words));
    program.logs("is open");
    let device = thread::spawn(move || {
        for part in [&RESPONSE_RTU[..], &RESPONSE_RTU[..4], &RESPONSE_RTU[..]] {
            adapter.outside.set_read_timeout(common::PATIENCE).unwrap();
            adapter.outside.read_exact(&mut [0; 8]).unwrap();
            thread::sleep(10 * CHARACTER); // the request's time on the wire, and the silence behind it
            for character in part {
                thread::sleep(CHARACTER); // its time on the wire
                adapter.outside.write_all(&[*character]).unwrap();
            }
        }
        adapter
    });
    let mut client = program.connect();
    assert_eq!(ask(&mut client, 1, &READ), RESPONSE);
    let asked = Instant::now();
    assert_eq!(ask(&mut client, 1, &READ), NO_RESPONSE);
    assert!(asked.elapsed() < Duration::from_secs(4), "the silence tells, not the time-out");
    assert_eq!(ask(&mut client, 1, &READ), RESPONSE);
    drop(device.join().unwrap());
}
