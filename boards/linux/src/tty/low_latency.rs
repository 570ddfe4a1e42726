//! Reduces the latency of a serial driver: characters are passed on at once instead of being collected.
//!
//! An FTDI adapter holds received characters back for up to 16 ms by default, eight times the silence that ends a Modbus frame at
//! 19200 baud. The kernel's flag ASYNC_LOW_LATENCY reduces that to 1 ms.

use std::fs;
use std::os::fd::AsFd;
use std::path::Path;

use rustix::io;
use rustix::ioctl::{Getter, Setter, ioctl};

/// `ASYNC_LOW_LATENCY` of linux/tty_flags.h.
const ASYNC_LOW_LATENCY: i32 = 1 << 13;
/// A higher latency timer hides frame gaps.
const LATENCY_MAX_MS: u32 = 1;

/// `struct serial_struct` of linux/serial.h.
#[repr(C)]
#[derive(Clone, Copy)]
struct SerialStruct {
    kind: i32,
    line: i32,
    port: u32,
    irq: i32,
    flags: i32,
    xmit_fifo_size: i32,
    custom_divisor: i32,
    baud_base: i32,
    close_delay: u16,
    io_type: u8,
    reserved: u8,
    hub6: i32,
    closing_wait: u16,
    closing_wait2: u16,
    iomem_base: *mut u8,
    iomem_reg_shift: u16,
    port_high: u32,
    iomap_base: libc::c_ulong,
}

/// Sets low latency on the open line `tty` of `device`; logs a warning if the device is known to stay slow. Drivers without the
/// flag refuse it, which is no error.
pub(super) fn request(tty: impl AsFd, device: &Path) {
    let asked = set_flag(&tty);
    let Some(latency_ms) = latency_timer_ms(device) else { return };
    if latency_ms > LATENCY_MAX_MS {
        let reason = asked.err().map(|error| format!(" ({error})")).unwrap_or_default();
        log::warn!(
            "{}: the adapter holds received characters back for {latency_ms} ms and could not be told otherwise{reason}; \
             as root: echo {LATENCY_MAX_MS} > /sys/class/tty/{}/device/latency_timer",
            device.display(),
            tty_name(device).unwrap_or_default(),
        );
    }
}

fn set_flag(tty: &impl AsFd) -> io::Result<()> {
    // SAFETY: TIOCGSERIAL fills a `struct serial_struct`; `SerialStruct` has its layout, and any bytes are valid.
    let mut settings = unsafe { ioctl(tty, Getter::<{ libc::TIOCGSERIAL as _ }, SerialStruct>::new()) }?;
    if settings.flags & ASYNC_LOW_LATENCY != 0 {
        return Ok(());
    }
    settings.flags |= ASYNC_LOW_LATENCY;
    // SAFETY: TIOCSSERIAL reads a `struct serial_struct`; this is the one just read, with another flag.
    unsafe { ioctl(tty, Setter::<{ libc::TIOCSSERIAL as _ }, SerialStruct>::new(settings)) }
}

/// The latency timer of an FTDI adapter; other devices have none.
fn latency_timer_ms(device: &Path) -> Option<u32> {
    let file = format!("/sys/class/tty/{}/device/latency_timer", tty_name(device)?);
    fs::read_to_string(file).ok()?.trim().parse().ok()
}

/// `ttyUSB0` for `/dev/ttyUSB0` or a link to it in `/dev/serial/by-id`.
fn tty_name(device: &Path) -> Option<String> {
    let target = fs::canonicalize(device).ok()?;
    Some(target.file_name()?.to_string_lossy().into_owned())
}
