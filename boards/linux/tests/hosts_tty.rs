//! Serial lines on PTYs, which behave like ttys but have no wire.

use std::path::PathBuf;
use std::thread;

use embassy_time::{Duration, Instant};
use embedded_io_async::{Read, Write};
use futures_lite::future::poll_once;
use mobgate::hal::{OpenErrorKind, SerialHost, SerialLine};
use mobgate::settings::{Driver, LineSettings, Parity};
use mobgate_linux::reactor::block_on;
use mobgate_linux::tty::{Tty, TtyHost};
use serial2::SerialPort;

/// The two ends of a PTY and the second one's name. The second end is kept: a PTY without it reads as hung up.
fn pty() -> (SerialPort, SerialPort, String) {
    let (outside, inside) = SerialPort::pair().unwrap();
    let name = rustix::termios::ttyname(&inside, Vec::new()).unwrap().into_string().unwrap();
    (outside, inside, name)
}

fn open(device: &str, line: &LineSettings) -> Result<Tty, OpenErrorKind> {
    block_on(TtyHost.open(device, line)).map_err(|error| error.kind)
}

#[test]
fn bytes_pass_both_ways_unchanged() {
    let (outside, _inside, name) = pty();
    let mut line = open(&name, &LineSettings::DEFAULT).unwrap();
    let every_byte: Vec<u8> = (0..=255).collect();
    let mut text = [0; 512];
    outside.write_all(&every_byte).unwrap();
    let count = block_on(line.read(&mut text)).unwrap();
    assert_eq!(text[..count], every_byte);
    block_on(line.write_all(&every_byte)).unwrap();
    let mut back = [0; 256];
    outside.read_exact(&mut back).unwrap();
    assert_eq!(back.to_vec(), every_byte);
}

#[test]
fn dropping_a_pending_read_loses_no_byte() {
    let (outside, _inside, name) = pty();
    let mut line = open(&name, &LineSettings::DEFAULT).unwrap();
    let mut text = [0; 8];
    assert!(block_on(poll_once(line.read(&mut text))).is_none());
    outside.write_all(b"late").unwrap();
    assert_eq!(block_on(line.read(&mut text)).unwrap(), 4);
}

#[test]
fn what_comes_while_a_line_is_left_to_itself_is_read_afterwards_at_once() {
    let (outside, _inside, name) = pty();
    let mut line = open(&name, &LineSettings::DEFAULT).unwrap();
    let mut text = [0; 8];
    assert!(block_on(poll_once(line.read(&mut text))).is_none(), "nothing has come");
    let sender = thread::spawn(move || {
        for byte in b"three" {
            outside.write_all(&[*byte]).unwrap();
            thread::sleep(std::time::Duration::from_millis(1)); // a slow wire
        }
        outside
    });
    // Longer than it takes to send all, also on a busy machine.
    let until = Instant::now() + Duration::from_secs(2);
    assert!(block_on(line.rest(until)));
    assert!(Instant::now() >= until);
    let outside = sender.join().unwrap();
    assert_eq!(block_on(line.read(&mut text)).unwrap(), 5);

    // From here on each byte wakes the reader again.
    let sender = thread::spawn(move || {
        thread::sleep(std::time::Duration::from_millis(20)); // the reader is asleep by then
        outside.write_all(b"again").unwrap();
        outside
    });
    assert_eq!(block_on(line.read(&mut text)).unwrap(), 5);
    sender.join().unwrap();
}

#[test]
fn a_rest_that_is_dropped_loses_no_byte_and_one_that_is_too_short_is_none() {
    let (outside, _inside, name) = pty();
    let mut line = open(&name, &LineSettings::DEFAULT).unwrap();
    assert!(!block_on(line.rest(Instant::now())));
    assert!(block_on(poll_once(line.rest(Instant::now() + Duration::from_secs(60)))).is_none());
    outside.write_all(b"late").unwrap();
    assert_eq!(block_on(line.read(&mut [0; 8])).unwrap(), 4);
}

#[test]
fn a_line_takes_any_speed_and_format() {
    let (_outside, inside, name) = pty();
    let odd = LineSettings {
        baud: 31_250,
        data_bits: 7,
        parity: Parity::Odd,
        stop_bits: 2,
        ..LineSettings::DEFAULT
    };
    let _line = open(&name, &odd).unwrap();
    assert_eq!(inside.get_configuration().unwrap().get_baud_rate().unwrap(), 31_250);
}

#[test]
fn a_line_is_open_once_until_it_is_dropped() {
    let (_outside, _inside, name) = pty();
    let line = open(&name, &LineSettings::DEFAULT).unwrap();
    assert_eq!(open(&name, &LineSettings::DEFAULT).unwrap_err(), OpenErrorKind::InUse);
    drop(line);
    open(&name, &LineSettings::DEFAULT).unwrap();
}

#[test]
fn a_link_by_id_is_followed() {
    let (_outside, _inside, name) = pty();
    let folder = tempfile::tempdir().unwrap();
    let link: PathBuf = folder.path().join("usb-FTDI_FT232R_USB_UART_A50285BI-if00-port0");
    std::os::unix::fs::symlink(name, &link).unwrap();
    open(link.to_str().unwrap(), &LineSettings::DEFAULT).unwrap();
}

#[test]
fn a_hang_up_ends_the_line() {
    let (outside, _inside, name) = pty();
    let mut line = open(&name, &LineSettings::DEFAULT).unwrap();
    drop(outside);
    let ended = block_on(line.read(&mut [0; 8]));
    assert!(matches!(ended, Ok(0) | Err(_)), "read {ended:?} from a line that is gone");
    assert!(block_on(line.write_all(b"into the void")).is_err());
}

#[test]
fn what_cannot_be_opened_is_told_apart() {
    let open = |device| open(device, &LineSettings::DEFAULT).unwrap_err();
    assert_eq!(open("/dev/ttyNOWHERE7"), OpenErrorKind::NotFound);
    assert_eq!(open("ttyNOWHERE7"), OpenErrorKind::NotFound);
    assert_eq!(open("/dev/null"), OpenErrorKind::Unsupported);
}

#[test]
fn a_pty_has_no_rs485_driver_and_no_rts_and_says_so() {
    let (_outside, _inside, name) = pty();
    for driver in [Driver::Rs485, Driver::Rts] {
        let line = LineSettings { driver, ..LineSettings::DEFAULT };
        assert_eq!(open(&name, &line).unwrap_err(), OpenErrorKind::Unsupported);
    }
}
