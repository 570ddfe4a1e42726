//! The program killed while it saves, stopped while it serves, and with a wall clock that steps.

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use mobgate_simulator::device::rtu::frame;
use rustix::process::Signal;
use serial2::SerialPort;

use common::{PATIENCE, Program, ask, mobgate, wait_for};

mod common;

/// Saves that are killed.
const KILLS: u32 = 200;
/// Saves that follow each other in one run, of which the kill meets one.
const SAVES: u32 = 40;
/// The longest time from the first of them to the kill: less than they take together.
const DELAY_US_MAX: u64 = 50_000;
/// The longest time from the moment when a new file is seen.
const DELAY_SEEN_US_MAX: u64 = 1_000;

/// A file of some length, with a comment before each of its lines.
fn file(timeout_ms: u32) -> String {
    let port = format!("# made by hand\nport P1  tcp client 127.0.0.1:1 timeout {timeout_ms}ms # changes\n");
    let rules = (1..=60).map(|unit| format!("# device {unit}\nroute ask {unit} * * P1\n"));
    format!("port ask scanner\n{port}{}", rules.collect::<String>())
}

/// The texts in a file of versions, which has nothing else.
fn texts(mut file: &str) -> impl Iterator<Item = &str> {
    std::iter::from_fn(move || {
        let (head, rest) = file.split_once('\n')?;
        let (head, _sum) = head.rsplit_once('\t').unwrap();
        let (_, length) = head.rsplit_once('\t').unwrap();
        let (text, behind) = rest.split_at(length.parse().unwrap());
        file = behind;
        Some(text)
    })
}

#[test]
fn after_a_kill_in_any_of_200_saves_the_file_is_the_old_one_or_the_new_one() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("mobgate.conf");
    fs::write(&config, file(1_001)).unwrap();
    let versions = folder.path().join("mobgate.conf.versions");
    let others = || {
        let names = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path());
        names.filter(|name| *name != config && *name != versions).count()
    };
    let (mut value, mut left, mut last, mut seed) = (1_001, 0, 0, 1_u64);
    for run in 0..KILLS {
        let mut command = mobgate();
        command.arg("--config").arg(&config).args(["--socket", "off"]).env("RUST_LOG", "off");
        let mut program =
            command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut lines = program.stdin.take().unwrap();
        let saves = (1..=SAVES).map(|n| format!("edit port P1 timeout {}ms\nsave\n", value + n));
        lines.write_all(saves.collect::<String>().as_bytes()).unwrap();
        let mut said = BufReader::new(program.stdout.take().unwrap());
        let mut first = String::new();
        said.read_line(&mut first).unwrap();
        assert_eq!(first, "saved\n");
        assert!(others() <= 1, "saves before this start have left files");
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let within = match run % 2 {
            0 => DELAY_US_MAX,
            _ => {
                // From here on there is no time to sleep.
                let begun = Instant::now();
                while others() == 0 && begun.elapsed() < PATIENCE {}
                DELAY_SEEN_US_MAX
            }
        };
        let (begun, delay) = (Instant::now(), Duration::from_micros((seed >> 33) % within));
        while begun.elapsed() < delay {}
        program.kill().unwrap();
        program.wait().unwrap();
        let text = fs::read_to_string(&config).unwrap();
        let whole = (value + 1..=value + SAVES).find(|value| text == file(*value));
        let whole = whole.unwrap_or_else(|| panic!("neither the old file nor the new one:\n{text}"));
        let kept = texts(&fs::read_to_string(&versions).unwrap()).map(str::to_owned).collect::<Vec<_>>();
        let last_kept = [whole, whole - 1].map(file).contains(&kept[0]);
        assert!(last_kept, "the version kept last is neither the file nor the one before it:\n{}", kept[0]);
        assert!(kept.len() <= 10, "{} versions", kept.len());
        left += others();
        last += u32::from(whole == value + SAVES);
        value = whole;
    }
    println!("{KILLS} kills, {left} while the new file was there, {last} behind the last save");
    assert!(left > 0, "no kill met a save");
}

/// A unit 1 on a PTY: each of its registers has its own address as its value.
struct Device {
    // It stays open, or the PTY hangs up before the program has opened it.
    _inside: SerialPort,
    name: String,
}

impl Device {
    /// Responds until the test ends.
    fn start() -> Self {
        let (mut outside, inside) = SerialPort::pair().unwrap();
        let name = rustix::termios::ttyname(&inside, Vec::new()).unwrap().into_string().unwrap();
        outside.set_read_timeout(10 * PATIENCE).unwrap();
        thread::spawn(move || {
            let mut request = [0; 8];
            while outside.read_exact(&mut request).is_ok() {
                if request[0] != 1 {
                    continue; // nobody's
                }
                let (first, count) = (u16::from_be_bytes([request[2], request[3]]), request[5]);
                let mut response = vec![3, 2 * count];
                response.extend((first..first + u16::from(count)).flat_map(u16::to_be_bytes));
                thread::sleep(Duration::from_millis(3)); // as a device takes
                if outside.write_all(&frame(1, &response)).is_err() {
                    return;
                }
            }
        });
        Self { _inside: inside, name }
    }
}

/// What a client has got.
#[derive(Default)]
struct Got {
    responses: u32,
    refusals: u32,
}

/// Reads one register after the other until `over`; each client asks for others.
fn read_on(mut client: TcpStream, nth: u16, over: &AtomicBool) -> Got {
    let mut got = Got::default();
    let mut address = 0x1000 * nth;
    while !over.load(Ordering::Relaxed) {
        address = 0x1000 * nth + (address + 1) % 0x1000;
        let [high, low] = address.to_be_bytes();
        match ask(&mut client, 1, &[3, high, low, 0, 1])[..] {
            [3, 2, a, b] if [a, b] == [high, low] => got.responses += 1,
            [0x83, 0x0b] => got.refusals += 1,
            ref other => panic!("{other:02x?} to a read of {address:#06x}"),
        }
    }
    got
}

#[test]
fn a_program_that_was_stopped_for_5_seconds_gives_no_wrong_response_and_goes_on() {
    let device = Device::start();
    let program = Program::configured(&format!(
        "port P1 serial {} rtu client 115200 timeout 300ms\nport P502 tcp server {{port}}\nroute P502 * * * P1\n",
        device.name
    ));
    program.logs("is open");
    let clients: Vec<_> = (1..=4).map(|nth| (nth, program.connect())).collect();
    let over = &AtomicBool::new(false);
    let got: Vec<Got> = thread::scope(|scope| {
        let running: Vec<_> = clients
            .into_iter()
            .map(|(nth, client)| scope.spawn(move || read_on(client, nth, over)))
            .collect();
        thread::sleep(Duration::from_secs(1)); // clients are busy
        program.signal(Signal::STOP);
        thread::sleep(Duration::from_secs(5)); // what is tried
        program.signal(Signal::CONT);
        // Whoever connects now is served, and so are the others.
        let mut late = program.connect();
        wait_for("a response", || (ask(&mut late, 1, &[3, 0, 7, 0, 2]) == [3, 4, 0, 7, 0, 8]).then_some(()));
        thread::sleep(Duration::from_secs(2)); // clients are busy again
        over.store(true, Ordering::Relaxed);
        running.into_iter().map(|client| client.join().unwrap()).collect()
    });
    let (responses, refusals) = got.iter().fold((0, 0), |(a, r), got| (a + got.responses, r + got.refusals));
    println!("stopped for 5 s: {responses} responses, {refusals} exceptions 0B, none wrong");
    // A request of each was open, and those that came then waited for the unit to be in step again.
    assert!(responses > 50 && refusals < responses / 4, "{responses} responses, {refusals} refusals");
    assert!(got.iter().all(|got| got.responses > 10));
}

/// A library that is loaded before the C library, in which the wall clock jumps two days to and fro every second.
const STEPPING: &str = r#"
#define _GNU_SOURCE
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

int clock_gettime(clockid_t clock, struct timespec *at) {
    int result = syscall(SYS_clock_gettime, clock, at);
    if (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE || clock == CLOCK_TAI) {
        at->tv_sec += at->tv_sec % 2 ? 86400 : -86400;
    }
    return result;
}

int gettimeofday(struct timeval *at, void *zone) {
    struct timespec now;
    (void)zone;
    clock_gettime(CLOCK_REALTIME, &now);
    at->tv_sec = now.tv_sec;
    at->tv_usec = now.tv_nsec / 1000;
    return 0;
}

time_t time(time_t *at) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (at) *at = now.tv_sec;
    return now.tv_sec;
}
"#;

/// Builds it with the compiler that links Rust programs, too.
fn stepping(folder: &Path) -> std::path::PathBuf {
    let (source, library) = (folder.join("stepping.c"), folder.join("stepping.so"));
    fs::write(&source, STEPPING).unwrap();
    let built =
        Command::new("cc").args(["-shared", "-fPIC", "-o"]).arg(&library).arg(source).status().unwrap();
    assert!(built.success());
    library
}

#[test]
fn a_wall_clock_that_steps_by_days_moves_no_timer_and_ends_no_session() {
    let (device, folder) = (Device::start(), tempfile::tempdir().unwrap());
    let settings = format!(
        "port P1 serial {} rtu client 115200 timeout 400ms down-after 0\nport P502 tcp server {{port}} idle 4s\n\
         route P502 * * * P1\n",
        device.name
    );
    let options = ["--config", "{folder}/mobgate.conf", "--socket", "off"];
    let stepping = stepping(folder.path());
    let program = Program::by(mobgate().env("LD_PRELOAD", stepping), &settings, &options);
    program.logs("is open");
    let mut idle = program.connect();
    let since = Instant::now();
    let mut client = program.connect();
    while since.elapsed() < Duration::from_secs(5) {
        // Nobody is unit 2: the time-out is as long as it is, whatever the wall clock does meanwhile.
        let asked = Instant::now();
        assert_eq!(ask(&mut client, 2, &[3, 0, 0, 0, 1]), [0x83, 0x0b]);
        assert!(asked.elapsed() >= Duration::from_millis(400), "gave up after {:?}", asked.elapsed());
        assert_eq!(ask(&mut client, 1, &[3, 1, 2, 0, 1]), [3, 2, 1, 2]);
    }
    // The other connection ends by its idle time: neither at once nor in a day.
    assert_eq!(idle.read(&mut [0; 1]).unwrap(), 0);
    assert!((4..PATIENCE.as_secs()).contains(&since.elapsed().as_secs()), "{:?}", since.elapsed());
    drop(client);
    let mut last = program.connect();
    let since = Instant::now();
    assert_eq!(last.read(&mut [0; 1]).unwrap(), 0);
    assert!(since.elapsed() >= Duration::from_millis(3_900), "ended after {:?}", since.elapsed());
    // Its log has the times of that clock, or all this would mean nothing.
    let log = program.log();
    let logged = seconds(log.trim_start_matches('[').split(' ').next().unwrap());
    let off = logged.abs_diff(seconds("now"));
    assert!((80_000..90_000).contains(&off), "the log's clock is {off} s off");
}

/// The seconds since 1970 that date(1) takes `time` for.
fn seconds(time: &str) -> u64 {
    let date = Command::new("date").args(["-u", "-d", time, "+%s"]).output().unwrap();
    String::from_utf8(date.stdout).unwrap().trim().parse().unwrap()
}
